function [y, x] = simulate(model, u, varargin)
% TOKID.SIMULATE  Outputs of a model for given inputs, all experiments at once.
%
%   y = tokid.simulate(model, u)
%   [y, x] = tokid.simulate(model, u, 'x0', x0)
%   y = tokid.simulate(model, data)            data of tokid.ensemble or tokid.read, or the name of a file
%   y = tokid.simulate(model, {u1, u2})        T_i x r each, gives cells of T_i x m
%
% u is N x T x r, y is N x T x m; y(i, k+1, :) is the output of experiment i at step k. x is N x (T+1) x n: x(i, k+1, :)
% is the state before step k, padded with zeros where it has fewer than n dimensions. NaN where the model has no step,
% and from a missing input on. A periodic model goes on behind its last step.
%
% The states start from zero, or, where they are unknown in model and data, from the mean of the experiments that the
% model was identified from, at the first step of the model (k_begin). Options:
%   'x0'              N x n states at that step, or n numbers for all experiments
%   'initial_state'   'zero' or 'unknown': of these experiments (default: as the data say, else as the model has it)
%   'estimate_state'  true: unknown initial states by the outputs of the first steps, which the data must have
%   'dt'              sample time of u, to be compared with the model's
%
% The recursion is done here, without the tool, so that it is fast in a loop; only 'estimate_state' and the names of
% files need the tool. Warnings have the identifier tokid:simulate. Errors: tokid:shape, tokid:model, tokid:option,
% tokid:input (an argument is missing).

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model', 'u');
if ischar(model) || isa(model, 'string')
  model = tokid.read(model);
end
if ischar(u) || isa(u, 'string')
  u = tokid.read(u);
end
checked = tokid.internal.check_model(model, {'A', 'B', 'C', 'D', 'state_dim'});
[data, said, lengths] = tokid.internal.take_data('simulate', {'x0', 'estimate_state'}, [{u}, varargin], false);
if isfield(said, 'estimate_state') && tokid.internal.truth('simulate', 'estimate_state', said.estimate_state)
  if nargout > 1 || isfield(said, 'x0')
    error('tokid:option', 'simulate: option ''estimate_state'' goes neither with ''x0'' nor with the states x');
  elseif ~isfield(data, 'y')
    error('tokid:shape', 'y: none found; ''estimate_state'' needs the outputs of the first steps');
  end
  given = {'', 'model', 'model', model; '', 'data', 'data', data; '-o', 'new', 'simulated', []};
  call = tokid.internal.take('simulate', given, 'estimate_state:flag', {'estimate_state', true});
  [~, simulated] = tokid.internal.run(call, nargout);
  y = simulated.y;
else
  tell_differences(checked, data);
  [y, x] = natively(checked, data, said);
end
y = tokid.internal.as_cells(y, lengths);
end

function [y, x] = natively(model, data, said)
[N, T, r] = size(data.u);
[m, n, S] = size(model.C);
[P, begin] = deal(model.period, model.k_begin);
if r ~= size(model.B, 2)
  error('tokid:shape', 'inputs: %d found, the model has %d', r, size(model.B, 2));
end
stop = min(begin + S, T);
if P > 0 && S >= P
  stop = T;
end
u = permute(data.u, [3, 1, 2]); % r x N x T, so that the samples of a step lie together
if isfield(data, 'length')
  for i = 1:N
    u(:, i, data.length(i) + 1:end) = NaN;
  end
end
u = plus_nominal(u, -model.u_nominal, P);
y = nan(m, N, T);
x = nan(n, N, T + 1);
both = cat(1, cat(2, model.C, model.D), cat(2, model.A, model.B));
state = zeros(n, N);
first = first_states(model, data, said, N);
state(1:size(first, 1), :) = first;
for k = begin:stop - 1 % step k has the samples k+1 and the matrices s
  s = k - begin + 1;
  if s > S
    s = S - P + 1 + mod(s - S - 1, P);
  end
  x(:, :, k + 1) = state;
  result = both(:, :, s) * [state; u(:, :, k + 1)];
  y(:, :, k + 1) = result(1:m, :);
  state = result(m + 1:m + n, :);
  state(model.state_dim(s + 1) + 1:n, :) = 0; % where a missing input has left NaN
end
if stop > begin
  x(:, :, stop + 1) = state;
end
if all(isnan(y(:)))
  warning('tokid:simulate', 'all computed outputs are missing (NaN): the model gives no output at any step of the data');
end
y = permute(plus_nominal(y, model.y_nominal, P), [2, 3, 1]);
x = permute(x, [2, 3, 1]);
end

function values = plus_nominal(values, nominal, P)
% values (channels x N x T) and the mean motion (steps x channels), which goes on as a periodic model does
T = size(values, 3);
known = size(nominal, 1);
steps = 1:min(known, T);
if P > 0 && known >= P
  steps = [steps, known - P + 1 + mod(0:T - known - 1, P)];
end
values(:, :, 1:numel(steps)) = values(:, :, 1:numel(steps)) + permute(nominal(steps, :), [2, 3, 1]);
end

function state = first_states(model, data, said, N)
n = sum(model.state_dim(1:min(1, end)));
state = zeros(n, N);
if isfield(said, 'x0') && ~isempty(said.x0)
  x0 = said.x0;
  if ~tokid.internal.is_real(x0)
    error('tokid:shape', 'x0: a value of class %s found, real numbers needed', class(x0));
  elseif isequal(size(x0), [N, n])
    state = double(x0)';
  elseif isvector(x0) && numel(x0) == n
    state = repmat(double(x0(:)), 1, N);
  else
    error('tokid:shape', 'x0: %d x %d found, %d experiments x %d states needed, or %d numbers', size(x0, 1), ...
          size(x0, 2), N, n, n);
  end
  return
end
of_model = value_of(model, 'initial_state', 'zero');
of_data = value_of(data, 'initial_state', of_model);
start = 'zero state';
if n > 0 && strcmp(of_data, 'unknown') && strcmp(of_model, 'unknown') && numel(value_of(model, 'x0_mean', [])) == n ...
    && isequal(size(value_of(model, 'x0_cov', [])), [n, n])
  state = repmat(model.x0_mean(:), 1, N);
  start = 'mean initial state';
end
if n > 0 && ~(strcmp(of_data, 'zero') && model.k_begin == 0)
  warning('tokid:simulate', ['the initial states are unknown: the simulation starts from the %s at step %d, ' ...
                             'where the model begins'], start, model.k_begin);
end
end

function tell_differences(model, data)
% Differences that are no error, but may be a mistake.
if isfield(data, 'dt') && abs(model.dt - data.dt) > 1e-6 * model.dt
  warning('tokid:simulate', 'the data''s dt = %g s differs from the model''s dt = %g s', data.dt, model.dt);
end
found = value_of(data, 'input_names', {});
known = cellstr(value_of(model, 'input_names', {}));
if ~isempty(found) && ~isempty(known) && ~isequal(found(:), known(:))
  warning('tokid:simulate', 'the data''s inputs are named %s, the model''s %s', strjoin(found(:)', ', '), ...
          strjoin(known(:)', ', '));
end
end

function value = value_of(s, name, default)
if isfield(s, name) && ~isempty(s.(name))
  value = s.(name);
else
  value = default;
end
end
