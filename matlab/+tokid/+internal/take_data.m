function [file, pairs, files, lengths] = take_data(folder, needs_outputs, given, model, others)
% [file, pairs, files, lengths] = tokid.internal.take_data(folder, needs_outputs, given, model, others) gives the file
% of the data for the tool. `given` begins with the name of a file, the struct of an ensemble, an iddata object, or the
% arrays or cells u and y (u alone where no outputs are needed), and goes on with names and values; those that don't
% belong to the data come back in `pairs`. Where arrays don't say their sample time, it is that of `model`, a struct or
% the name of a file as the tool takes it; for tokid.update {state}, the name of a state; [] where there is none.
% `others`: as tokid.internal.take_fields has it. `lengths` of the experiments where they are cells, else [].

% SPDX-License-Identifier: BSD-3-Clause

if isempty(given)
  error('tokid:shape', 'data: none found; arrays, an ensemble or the name of a file needed');
end
lengths = [];
first = given{1};
if ischar(first) || isa(first, 'string')
  file = tokid.internal.file_name(first);
  files = cell(0, 2);
  pairs = given(2:end);
  return
elseif isstruct(first)
  data = first;
  pairs = given(2:end);
elseif isa(first, 'iddata')
  data = tokid.internal.of_iddata(first);
  pairs = given(2:end);
  lengths = cellfun(@(c) size(c, 1), data.u(:));
else
  data = struct();
  data.u = first;
  pairs = given(2:end);
  if needs_outputs
    if isempty(pairs) || ~(iscell(pairs{1}) || isnumeric(pairs{1}) || islogical(pairs{1}))
      error('tokid:shape', ['y: none found after u of class %s. Outputs (N x T x m) needed; or in place of u and y ' ...
                            'a struct of tokid.ensemble, an iddata object or the name of a file'], class(first));
    end
    data.y = pairs{1};
    pairs = pairs(2:end);
  end
  if iscell(first)
    lengths = cellfun(@(c) size(c, 1), first(:));
  end
end
[data, pairs] = tokid.internal.take_fields(data, pairs, others);
data = tokid.internal.ensemble(data, needs_outputs);
if ~isfield(data, 'dt')
  dt = [];
  if isstruct(model) && isfield(model, 'dt')
    dt = model.dt;
  elseif ischar(model) || isa(model, 'string')
    dt = tokid.internal.sample_time(folder, tokid.internal.file_name(model), 'model');
  elseif iscell(model)
    dt = tokid.internal.sample_time(folder, tokid.internal.file_name(model{1}), 'state');
  end
  if ~isempty(dt)
    data.dt = dt;
  end
end
file = fullfile(folder, 'data.mat');
files = {file, 'data'};
tokid.internal.write_ensemble(file, data);
end
