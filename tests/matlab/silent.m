function silent(f)
% silent(f): does f() end without a warning?

% SPDX-License-Identifier: BSD-3-Clause

lastwarn('', '');
f();
assert(isempty(lastwarn()), 'warning: %s', lastwarn());
end
