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
if any(cellfun(@isempty, times(:)))
  error('tokid:shape', ['data: an iddata object without Ts found, one sample time needed. Its samples are at ' ...
                        'uneven SamplingInstants. Interpolate them to equal steps, for example by interp1']);
elseif any(cellfun(@(t) ~isequal(t, times{1}), times(:)))
  error('tokid:shape', 'data: an iddata object with several sample times found, one for all experiments needed');
elseif times{1} > 0 % Octave has -1 where it is not stated
  data.dt = times{1} * seconds_of(z.TimeUnit);
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

function seconds = seconds_of(unit)
% The length of a unit of time in seconds.
units = {'nanoseconds', 1e-9; 'microseconds', 1e-6; 'milliseconds', 1e-3; 'seconds', 1; 's', 1; 'minutes', 60; ...
         'hours', 3600; 'days', 86400; 'weeks', 604800};
at = find(strcmpi(unit, units(:, 1)));
if isempty(unit) % Octave's default
  seconds = 1;
elseif isempty(at)
  error('tokid:shape', 'data: an iddata object with the TimeUnit ''%s'' found, one of %s needed', unit, ...
        strjoin(units(:, 1)', ', '));
else
  seconds = units{at, 2};
end
end

function list = as_list(value)
if iscell(value)
  list = value;
else
  list = {value};
end
end
