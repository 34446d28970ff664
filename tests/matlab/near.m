function near(found, expected, tolerance)
% near(found, expected, tolerance): the same size, NaN in the same places, and elsewhere equal up to `tolerance` times
% the largest value.

% SPDX-License-Identifier: BSD-3-Clause

assert(isequal(size(found), size(expected)), 'size %s found, %s expected', mat2str(size(found)), ...
       mat2str(size(expected)));
assert(isequal(isnan(found), isnan(expected)), 'NaN in other places');
scale = max(abs(expected(:)));
assert(scale > 0);
difference = max(abs(found(:) - expected(:)));
assert(difference <= tolerance * scale, 'differs by %g, of %g', difference, scale);
end
