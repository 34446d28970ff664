function yes = truth(command, name, value)
% The value of an option that is true or false. Errors: tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

if ~tokid.internal.is_real(value) || ~isscalar(value) || ~any(value == [0, 1])
  error('tokid:option', '%s: option ''%s'': true or false needed', command, name);
end
yes = value == 1;
end
