function data = of_iddata(z)
% data = tokid.internal.of_iddata(z) gives the experiments, the sample time and the names of an iddata object of the
% System Identification Toolbox, or of Octave's control package, as a struct for tokid.internal.ensemble. Errors:
% tokid:shape.

% SPDX-License-Identifier: BSD-3-Clause

domain = z.Domain; % 'Time' or 'Frequency'; in Octave true or false
if strncmpi(domain, 'f', 1) || isequal(domain, false)
  error('tokid:shape', 'data: an iddata object over frequencies found, samples over time needed');
end
data.u = as_list(z.u);
if ~isempty(z.y)
  data.y = as_list(z.y);
end
if all(cellfun(@isempty, data.u(:)))
  error('tokid:shape', 'data: an iddata object without inputs found. tokid identifies responses to inputs');
end
times = as_list(z.Ts);
if any(cellfun(@(t) ~isequal(t, times{1}), times(:)))
  error('tokid:shape', 'data: an iddata object with several sample times found, one for all experiments needed');
elseif ~isempty(times{1})
  if times{1} > 0 % Octave has -1 where it is not stated
    data.dt = times{1};
  end
end
names = {'input_names', 'InputName'; 'output_names', 'OutputName'; 'input_units', 'InputUnit'; ...
         'output_units', 'OutputUnit'; 'experiment_names', 'ExperimentName'};
for i = 1:size(names, 1)
  texts = cellstr(z.(names{i, 2}));
  if ~isempty(texts) && ~all(cellfun(@isempty, texts(:)))
    data.(names{i, 1}) = texts(:);
  end
end
end

function list = as_list(value)
if iscell(value)
  list = value;
else
  list = {value};
end
end
