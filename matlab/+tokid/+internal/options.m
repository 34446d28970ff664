function said = options(command, names, pairs)
% said = tokid.internal.options(command, names, pairs) makes a struct out of names and values. `names` are the known
% ones. If a name comes twice, its last value counts. Strings become rows or cells of characters. Errors: tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

said = struct();
for i = 1:2:numel(pairs)
  name = tokid.internal.option_name(pairs{i});
  if ~any(strcmp(name, names))
    error('tokid:option', '%s: option ''%s'' found, one of %s needed', command, char(pairs{i}), ...
          strjoin(unique(names), ', '));
  elseif i == numel(pairs)
    error('tokid:option', '%s: option ''%s'' has no value', command, name);
  end
  value = pairs{i + 1};
  if tokid.internal.is_text(value)
    value = char(value);
  elseif isa(value, 'string')
    value = cellstr(value);
  end
  said.(name) = value;
end
end
