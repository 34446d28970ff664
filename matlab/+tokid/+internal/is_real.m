function yes = is_real(value)
% Is the value an array of real numbers?

% SPDX-License-Identifier: BSD-3-Clause

yes = (isnumeric(value) || islogical(value)) && isreal(value);
end
