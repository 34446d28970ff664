function file = written(call, folder, kind, name, value)
% file = tokid.internal.written(call, folder, kind, name, value) gives the file of a value for the tool: one given by its
% name, or a temporary one called by `name`. Data without a sample time get that of the model or state of the call.
% Errors: tokid:model, tokid:shape, tokid:input.

% SPDX-License-Identifier: BSD-3-Clause

if ischar(value) || isa(value, 'string') || (strcmp(kind, 'controller') && ~isstruct(value))
  file = tokid.internal.file_name(value);
  return
end
if strcmp(kind, 'reference')
  name = 'the reference';
end
file = fullfile(folder, [name, '.mat']);
switch kind
  case 'model'
    file = fullfile(folder, 'models', [name, '.mat']);
    value = of_model(value);
  case 'data'
    value = of_data(call, tokid.internal.ensemble(value, false, struct()));
  case 'reference'
    y = reshape(value, [1, size(value)]);
    value = of_data(call, tokid.internal.ensemble(struct('u', zeros(1, size(y, 2)), 'y', y), false, struct()));
end
tokid.internal.write_mat(file, value);
end

function contents = of_model(model)
% Fields that are empty, or that no model has, are left out.
needed = {'A', 'B', 'C', 'D', 'G', 'state_dim'};
checked = tokid.internal.check_model(model, needed);
contents = struct();
for name = fieldnames(model)'
  value = checked.(name{1});
  plain = isnumeric(value) || islogical(value) || ischar(value) || iscellstr(value) || isa(value, 'string');
  if any(strcmp(name{1}, {'input_names', 'output_names', 'input_units', 'output_units'})) && ~isempty(value)
    contents.(name{1}) = reshape(cellstr(value), [], 1);
  elseif isa(value, 'string')
    contents.(name{1}) = char(value);
  elseif plain && (~isempty(model.(name{1})) || any(strcmp(name{1}, needed)))
    contents.(name{1}) = value;
  end
end
end

function data = of_data(call, data)
at = find(ismember(call.given(:, 2), {'model', 'state'}), 1);
if ~isfield(data, 'dt') && ~isempty(at)
  data.dt = sample_time(call.given{at, [2, 4]});
end
data.experiments = size(data.u, 1); % which says that N x T is one channel of N experiments
end

function dt = sample_time(kind, source)
% [] of a state that cannot be read, of which the tool will complain
dt = [];
if isstruct(source)
  if isfield(source, 'dt')
    dt = source.dt;
  end
elseif strcmp(kind, 'model')
  evidence = tokid.internal.run(tokid.internal.take('info', {'', 'file', 'model', source}, '', {}), 1);
  dt = evidence.dt;
else
  try
    if tokid.internal.is_octave()
      dt = getfield(load(source, 'dt'), 'dt'); %#ok<GFLD> % nothing else of the file, which may be large
    else
      dt = h5read(source, '/dt');
    end
  catch
    return
  end
end
end
