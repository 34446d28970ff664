function value = decode(text, folder)
% What the tool says in JSON as a struct. Infinite numbers, which JSON has none of, are those; the names of temporary
% files are [], as what is not known; lists of texts are columns of cells, however many they hold.

% SPDX-License-Identifier: BSD-3-Clause

value = with_lists(clean(jsondecode(text), folder));
if isfield(value, 'verdict') && isstruct(value.verdict)
  value.verdict = with_lists(value.verdict);
end
end

function value = with_lists(value)
lists = {'warnings', 'reasons', 'output_names', 'input_names'};
for i = 1:numel(lists)
  if isfield(value, lists{i}) && isempty(value.(lists{i}))
    value.(lists{i}) = cell(0, 1);
  elseif isfield(value, lists{i})
    value.(lists{i}) = reshape(cellstr(value.(lists{i})), [], 1);
  end
end
end

function value = clean(value, folder)
if ischar(value)
  if strcmp(value, 'infinity')
    value = Inf;
  elseif strncmp(value, folder, numel(folder))
    value = [];
  end
elseif iscell(value)
  value = cellfun(@(v) clean(v, folder), value, 'UniformOutput', false);
  if ~isempty(value) && all(cellfun(@(v) isnumeric(v) && isscalar(v), value(:)))
    value = cellfun(@double, value);
  end
elseif isstruct(value)
  names = fieldnames(value);
  for i = 1:numel(value)
    for j = 1:numel(names)
      value(i).(names{j}) = clean(value(i).(names{j}), folder);
    end
  end
end
end
