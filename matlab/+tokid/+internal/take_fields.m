function [data, rest] = take_fields(data, pairs, others)
% [data, rest] = tokid.internal.take_fields(data, pairs, others) moves what belongs to the data from the names and
% values into the struct. `others` are names that the function itself has a use for.

% SPDX-License-Identifier: BSD-3-Clause

if nargin < 3
  others = {};
end
fields = tokid.internal.data_fields();
fields = fields(~ismember(fields, others));
rest = {};
for i = 1:2:numel(pairs)
  name = tokid.internal.option_name(pairs, i);
  if any(strcmp(name, fields)) && i < numel(pairs)
    data.(name) = pairs{i + 1};
  else
    rest = [rest, pairs(i:min(i + 1, numel(pairs)))]; %#ok<AGROW>
  end
end
end
