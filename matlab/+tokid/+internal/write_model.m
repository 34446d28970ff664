function write_model(file, model)
% Writes a model, without what is no part of one and without what is empty and may be absent. Errors: tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

needed = {'A', 'B', 'C', 'D', 'G', 'state_dim'};
others = {'k_begin', 'period', 'dt', 'frame', 'method', 'initial_state', 'innovation_cov', 'singular_values', ...
          'condition', 'rank', 'lags', 'u_nominal', 'y_nominal', 'Q', 'R', 'K', 'x0_mean', 'x0_cov', 'input_names', ...
          'output_names', 'input_units', 'output_units', 'options', 'version'};
tokid.internal.check_model(model, needed);
contents = struct();
for i = 1:numel(needed)
  contents.(needed{i}) = model.(needed{i});
end
for i = 1:numel(others)
  if isfield(model, others{i}) && ~isempty(model.(others{i}))
    contents.(others{i}) = model.(others{i});
  end
end
names = {'input_names', 'output_names', 'input_units', 'output_units'};
for i = 1:numel(names)
  if isfield(contents, names{i})
    contents.(names{i}) = reshape(cellstr(contents.(names{i})), [], 1);
  end
end
texts = {'frame', 'method', 'initial_state', 'options', 'version'};
for i = 1:numel(texts)
  if isfield(contents, texts{i})
    contents.(texts{i}) = char(contents.(texts{i}));
  end
end
tokid.internal.write_mat(file, contents);
end
