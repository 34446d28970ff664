function [data, said, lengths] = take_data(command, names, given, needs_outputs)
% [data, said, lengths] = tokid.internal.take_data(command, names, given, needs_outputs) takes data from the beginning
% of the arguments `given`, and options from the rest. Data are the name of a file, the struct of an ensemble, an iddata
% object, or the arrays or cells u and y (u alone if no outputs are needed). `names` are the options of the function.
% Other properties of the data become fields of the ensemble. `lengths`: as tokid.internal.ensemble has it.

% SPDX-License-Identifier: BSD-3-Clause

if isempty(given)
  error('tokid:shape', 'data: none found; arrays, an ensemble or the name of a file needed');
end
data = given{1};
pairs = given(2:end);
lengths = [];
if ischar(data) || isa(data, 'string')
  data = tokid.internal.file_name(data);
  said = tokid.internal.options(command, names, pairs);
  return
elseif ~isstruct(data) && ~isa(data, 'iddata')
  data = struct();
  data.u = given{1};
  if needs_outputs
    if isempty(pairs) || ~(iscell(pairs{1}) || isnumeric(pairs{1}) || islogical(pairs{1}))
      error('tokid:shape', ['y: none found after u of class %s. Outputs (N x T x m) needed; or in place of u and y ' ...
                            'a struct of tokid.ensemble, an iddata object or the name of a file'], class(given{1}));
    end
    data.y = pairs{1};
    pairs = pairs(2:end);
  end
end
fields = setdiff(tokid.internal.data_fields(), names);
said = tokid.internal.options(command, [names, fields], pairs);
fields = fields(isfield(said, fields));
properties = rmfield(said, setdiff(fieldnames(said), fields));
said = rmfield(said, fields);
[data, lengths] = tokid.internal.ensemble(data, needs_outputs, properties);
end
