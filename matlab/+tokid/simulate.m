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
names = {'x0', 'estimate_state'};
[data, said, lengths] = tokid.internal.take_data('simulate', names, [{u}, varargin], false);
if isfield(said, names{2}) && tokid.internal.truth('simulate', names{2}, said.estimate_state)
  if nargout > 1 || isfield(said, 'x0')
    error('tokid:option', ['simulate: option ''estimate_state'' goes neither with ''x0'' nor with ' ...
                           'the states x']);
  elseif ~isfield(data, 'y')
    error('tokid:shape', 'y: none found; ''estimate_state'' needs the outputs of the first steps');
  end
  given = {'', 'model', 'model', model; '', 'data', 'data', data; '-o', 'new', 'outputs.mat', []};
  call = tokid.internal.take('simulate', given, 'estimate_state:flag', {'estimate_state', true});
  [~, simulated] = tokid.internal.run(call);
  y = simulated.y;
else
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
tell_differences(model, data);
u = permute(data.u, [3, 1, 2]); % r x N x T, so that the samples of a step lie together
if isfield(data, 'length')
  u(:, (1:T) > data.length) = NaN;
end
u = plus_nominal(u, -model.u_nominal, P);
y = nan(m, N, T);
x = nan(n, N, T + 1);
both = cat(1, cat(2, model.C, model.D), cat(2, model.A, model.B));
state = zeros(n, N);
state(1:model.state_dim(1), :) = first_states(model, data, said, N);
places = tokid.internal.place(1:T - begin, S, P);
for k = begin + 1:begin + sum(places <= S)
  s = places(k - begin);
  x(:, :, k) = state;
  result = both(:, :, s) * [state; u(:, :, k)];
  y(:, :, k) = result(1:m, :);
  state = result(m + 1:end, :);
  state(model.state_dim(s + 1) + 1:n, :) = 0; % where a missing input has left NaN
  x(:, :, k + 1) = state;
end
if all(isnan(y(:)))
  warning('tokid:simulate', ['all computed outputs are missing (NaN): the model gives no output ' ...
                             'at any step of the data']);
end
y = permute(plus_nominal(y, model.y_nominal, P), [2, 3, 1]);
x = permute(x, [2, 3, 1]);
end

function values = plus_nominal(values, nominal, P)
% values (channels x N x T) and the mean motion (steps x channels), which goes on as a periodic model does
places = tokid.internal.place(1:size(values, 3), size(nominal, 1), P);
places = places(places <= size(nominal, 1));
steps = 1:numel(places);
values(:, :, steps) = values(:, :, steps) + permute(nominal(places, :), [2, 3, 1]);
end

function state = first_states(model, data, said, N)
n = model.state_dim(1);
state = zeros(n, N);
if isfield(said, 'x0') && ~isempty(said.x0)
  x0 = said.x0;
  if ~tokid.internal.is_real(x0)
    error('tokid:shape', 'x0: a value of class %s found, real numbers needed', class(x0));
  elseif isvector(x0) && numel(x0) == n && N > 1
    x0 = repmat(x0(:)', N, 1);
  elseif ~isequal(size(x0), [N, n])
    error('tokid:shape', ['x0: %d x %d found, %d experiments x %d states needed, or %d ' ...
                          'numbers'], size(x0, 1), size(x0, 2), N, n, n);
  end
  state = double(x0)';
  return
end
of_data = model.initial_state;
if isfield(data, 'initial_state')
  of_data = data.initial_state;
end
start = 'zero state';
known = numel(model.x0_mean) == n && isequal(size(model.x0_cov), [n, n]);
if n > 0 && known && strcmp(of_data, 'unknown') && strcmp(model.initial_state, 'unknown')
  state = repmat(model.x0_mean(:), 1, N);
  start = 'mean initial state';
end
if n > 0 && ~(strcmp(of_data, 'zero') && model.k_begin == 0)
  warning('tokid:simulate', ['the initial states are unknown: the simulation starts from the %s at ' ...
                             'step %d, where the model begins'], start, model.k_begin);
end
end

function tell_differences(model, data)
% Differences that are no error, but may be a mistake.
if isfield(data, 'dt') && abs(model.dt - data.dt) > 1e-6 * model.dt
  warning('tokid:simulate', 'the data''s dt = %g s differs from the model''s dt = %g s', ...
          data.dt, model.dt);
end
known = cellstr(model.input_names);
if isfield(data, 'input_names') && ~isempty(known) && ~isequal(data.input_names, known(:))
  warning('tokid:simulate', 'the data''s inputs are named %s, the model''s %s', ...
          strjoin(data.input_names', ', '), strjoin(known(:)', ', '));
end
end
