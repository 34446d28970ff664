function name = option_name(name)
% The name of an option as the functions know it: 'hold_out' for 'Hold_Out', 'hold-out' and "hold_out".

% SPDX-License-Identifier: BSD-3-Clause

if ~tokid.internal.is_text(name)
  error('tokid:option', 'the name of an option needed, a value of class %s found', class(name));
end
name = strrep(lower(char(name)), '-', '_');
end
