function yes = is_text(value)
% Is the value one text: a row of characters, or a string?

% SPDX-License-Identifier: BSD-3-Clause

yes = (ischar(value) && size(value, 1) == 1) || (isa(value, 'string') && isscalar(value));
end
