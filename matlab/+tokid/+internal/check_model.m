function model = check_model(model, needed)
% model = tokid.internal.check_model(model, needed) checks that this is a model with the fields `needed`, which must
% fit together. In the result, these are doubles, and zero outside the dimensions in use, where the model may hold
% anything. Fields that may be absent have their defaults. Errors: tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

if ~isstruct(model) || numel(model) ~= 1
  error('tokid:model', ['model: a value of class %s found, the struct of tokid.identify or ' ...
                        'tokid.read needed'], class(model));
end
missing = needed(~isfield(model, needed));
if ~isempty(missing)
  error('tokid:model', 'model: the field %s is missing', strjoin(missing, ', '));
end
for name = needed
  model.(name{1}) = numbers(name{1}, model.(name{1}));
end
[n, r, m, S] = deal(size(model.A, 1), size(model.B, 2), size(model.C, 1), size(model.A, 3));
sizes = struct('A', [n, n], 'B', [n, r], 'C', [m, n], 'D', [m, r], 'G', [n, m]);
matrices = needed(isfield(sizes, needed));
for name = matrices
  [rows, columns, steps] = size(model.(name{1}));
  if ~isequal([rows, columns, steps], [sizes.(name{1}), S])
    error('tokid:model', 'model: %s: %s found, %d x %d x %d needed beside A of %s', name{1}, ...
          tokid.internal.shape(model.(name{1})), sizes.(name{1}), S, tokid.internal.shape(model.A));
  end
end
states = model.state_dim(:);
if numel(states) ~= S + 1
  error('tokid:model', 'model: state_dim: %d numbers found, %d needed for %d steps', ...
        numel(states), S + 1, S);
elseif ~all(states >= 0 & states <= n & states == fix(states))
  error('tokid:model', 'model: state_dim: whole numbers from 0 to %d needed', n);
end
for s = find(states(1:S) < n | states(2:S + 1) < n)'
  for name = intersect(matrices, {'A', 'B', 'G'})
    model.(name{1})(states(s + 1) + 1:n, :, s) = 0;
  end
  model.A(:, states(s) + 1:n, s) = 0;
  model.C(:, states(s) + 1:n, s) = 0;
end
for name = matrices
  s = find(~all(all(isfinite(model.(name{1})), 1), 2), 1);
  if ~isempty(s)
    error('tokid:model', 'model: %s(:, :, %d) is not finite', name{1}, s);
  end
end

whole = @(v) isscalar(v) && v >= 0 && v == fix(v);
optional = {'dt', 1, @(v) isscalar(v) && v > 0 && ~isinf(v), 'a positive time in seconds'; ...
            'k_begin', 0, whole, 'a whole number from 0 on'; ...
            'period', 0, whole, 'a whole number from 0 on'; ...
            'u_nominal', zeros(0, r), @(v) ismatrix(v) && size(v, 2) == r, sprintf('T x %d', r); ...
            'y_nominal', zeros(0, m), @(v) ismatrix(v) && size(v, 2) == m, sprintf('T x %d', m); ...
            'initial_state', 'zero', [], ''; 'x0_mean', [], [], ''; 'x0_cov', [], [], ''; ...
            'input_names', {}, [], ''; 'output_names', {}, [], ''; ...
            'input_units', {}, [], ''; 'output_units', {}, [], ''};
for i = 1:size(optional, 1)
  [name, default, fits, wanted] = optional{i, :};
  if ~isfield(model, name) || isempty(model.(name))
    model.(name) = default;
  elseif ~isempty(fits)
    model.(name) = numbers(name, model.(name));
    if ~fits(model.(name))
      found = tokid.internal.shape(model.(name));
      if numel(model.(name)) < 3
        found = mat2str(model.(name));
      end
      error('tokid:model', 'model: %s: %s found, %s needed', name, found, wanted);
    end
  end
end
end

function value = numbers(name, value)
if ~tokid.internal.is_real(value)
  error('tokid:model', 'model: %s: %s of class %s found, real numbers needed', name, ...
        tokid.internal.shape(value), class(value));
end
value = double(value);
end
