function check_model(model, needed)
% Is this a model, with these fields, and do they fit together? Errors: tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

if ~isstruct(model) || numel(model) ~= 1
  error('tokid:model', 'model: a value of class %s found, the struct of tokid.identify or tokid.read needed', ...
        class(model));
end
missing = needed(~isfield(model, needed));
if ~isempty(missing)
  error('tokid:model', 'model: the field %s is missing', strjoin(missing, ', '));
end

for i = 1:numel(needed)
  check_numbers(needed{i}, model.(needed{i}));
end
n = size(model.A, 1);
r = size(model.B, 2);
m = size(model.C, 1);
S = size(model.A, 3);
sizes = struct('A', [n, n, S], 'B', [n, r, S], 'C', [m, n, S], 'D', [m, r, S], 'G', [n, m, S]);
matrices = needed(~strcmp(needed, 'state_dim'));
for i = 1:numel(matrices)
  name = matrices{i};
  found = size(model.(name));
  if ~isequal([found, ones(1, 3 - numel(found))], sizes.(name))
    error('tokid:model', 'model: %s: %s found, %s needed beside A of %s', name, shape(found), shape(sizes.(name)), ...
          shape(size(model.A)));
  end
end
states = double(model.state_dim(:));
if numel(states) ~= S + 1
  error('tokid:model', 'model: state_dim: %d numbers found, %d needed for %d steps', numel(states), S + 1, S);
elseif ~all(states >= 0 & states <= n & states == fix(states))
  error('tokid:model', 'model: state_dim: whole numbers from 0 to %d needed', n);
end
for i = 1:numel(matrices)
  check_finite(matrices{i}, model.(matrices{i}), states);
end
check_scalar(model, 'dt', @(v) v > 0 && ~isinf(v), 'a positive time in seconds');
check_scalar(model, 'k_begin', @(v) v >= 0 && v == fix(v), 'a whole number from 0 on');
check_scalar(model, 'period', @(v) v >= 0 && v == fix(v), 'a whole number from 0 on');
check_nominal(model, 'u_nominal', r);
check_nominal(model, 'y_nominal', m);
end

function check_numbers(name, value)
if ~(isnumeric(value) || islogical(value)) || ~isreal(value)
  error('tokid:model', 'model: %s: %s of class %s found, real numbers needed', name, shape(size(value)), class(value));
end
end

function check_finite(name, value, states)
% What lies outside the dimensions in use is not read.
if all(isfinite(value(:)))
  return
end
for s = 1:size(value, 3)
  rows = 1:size(value, 1);
  columns = 1:size(value, 2);
  if any(strcmp(name, {'A', 'B', 'G'}))
    rows = 1:states(s + 1);
  end
  if any(strcmp(name, {'A', 'C'}))
    columns = 1:states(s);
  end
  used = value(rows, columns, s);
  if ~all(isfinite(used(:)))
    error('tokid:model', 'model: %s(:, :, %d) is not finite', name, s);
  end
end
end

function check_scalar(model, name, right, needed)
if isfield(model, name) && ~isempty(model.(name))
  value = model.(name);
  check_numbers(name, value);
  if ~isscalar(value) || ~right(value)
    error('tokid:model', 'model: %s: %s found, %s needed', name, mat2str(double(value)), needed);
  end
end
end

function check_nominal(model, name, channels)
if isfield(model, name) && ~isempty(model.(name))
  value = model.(name);
  check_numbers(name, value);
  if ndims(value) > 2 || size(value, 2) ~= channels %#ok<ISMAT>
    error('tokid:model', 'model: %s: %s found, T x %d needed', name, shape(size(value)), channels);
  end
end
end

function text = shape(sizes)
text = strjoin(arrayfun(@(n) sprintf('%d', n), sizes, 'UniformOutput', false), ' x ');
end
