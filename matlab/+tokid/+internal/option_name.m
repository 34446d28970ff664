function name = option_name(pairs, i)
% The name at place i of a list of names and values: 'hold_out', whether 'Hold_Out', 'hold-out' or "hold_out" was given.

% SPDX-License-Identifier: BSD-3-Clause

name = pairs{i};
if isa(name, 'string') && isscalar(name)
  name = char(name);
end
if ~ischar(name) || size(name, 1) ~= 1
  error('tokid:option', 'the name of an option needed, a value of class %s found', class(name));
end
name = strrep(lower(name), '-', '_');
end
