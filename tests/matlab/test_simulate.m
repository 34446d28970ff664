function test_simulate(name)
% Simulation and prediction, against the tool and against their equations.

% SPDX-License-Identifier: BSD-3-Clause

feval(name);
end

function check_against_tool(model, data, tolerance)
% The recursion in M against that in C++.
tokid.write('model.npz', model);
tokid.write('data.npz', data);
expected = by_tool('simulate', 'model.npz', 'data.npz', 'simulated.mat');
near(tokid.simulate(model, data), expected.y, tolerance);
near(tokid.simulate('model.npz', 'data.npz'), expected.y, tolerance);
end

function model = known(S, n, r, m)
% Orthogonal matrices: nothing dies out, nothing grows.
model = struct('A', zeros(n, n, S), 'B', randn(n, r, S), 'C', randn(m, n, S), 'D', randn(m, r, S), ...
               'G', 0.1 * randn(n, m, S), 'state_dim', n * ones(S + 1, 1), 'k_begin', 0, 'dt', 0.1, 'method', 'known');
for s = 1:S
  [model.A(:, :, s), ~] = qr(randn(n));
end
end

function case_dimensions_that_vary()
data = tokid.example_data('oscillator', 'experiments', 30, 'steps', 40);
model = tokid.identify(data);
assert(model.state_dim(1) < 4 && model.state_dim(5) == 4);
silent(@() check_against_tool(model, data, 1e-12));
near(tokid.simulate(model, data.u), data.y, 1e-10);
data.u(3, 20, 1) = NaN;
check_against_tool(model, data, 1e-12);
end

function case_states_that_come_and_go()
% What lies beyond the dimensions in use is not read, and nothing is left of a missing input once no state carries it.
model = known(9, 4, 2, 3);
model.state_dim = [0; 2; 4; 3; 0; 1; 4; 4; 2; 4];
data = tokid.ensemble(randn(5, 9, 2), [], 'dt', 0.1);
data.u(2, 3, 1) = NaN;
tokid.write('model.npz', model);
for s = 1:9
  model.A(model.state_dim(s + 1) + 1:4, :, s) = Inf;
  model.B(model.state_dim(s + 1) + 1:4, :, s) = NaN;
  model.C(:, model.state_dim(s) + 1:4, s) = 1e9;
end
tokid.write('data.npz', data);
expected = by_tool('simulate', 'model.npz', 'data.npz', 'simulated.mat');
y = tokid.simulate(model, data);
near(y, expected.y, 1e-12);
assert(any(isnan(y(2, 4, :))) && ~any(isnan(y(2, 5, :))));
end

function case_one_of_everything()
shapes = [1 1 1 1 1; 1 5 1 1 1; 4 5 1 1 1; 1 5 2 1 3; 5 3 3 3 3];
for i = 1:size(shapes, 1)
  s = shapes(i, :);
  model = known(s(2), s(3), s(4), s(5));
  check_against_tool(model, tokid.ensemble(randn(s(1), s(2), s(4)), [], 'dt', 0.1), 1e-12);
end
end

function case_begins_later_and_ends_earlier()
model = known(6, 3, 2, 2);
model.k_begin = 2;
model.initial_state = 'unknown';
data = tokid.ensemble(randn(4, 11, 2), [], 'dt', 0.1);
y = warns('tokid:simulate', 'from the zero state at step 2', @() tokid.simulate(model, data));
assert(isequal(squeeze(~any(any(isnan(y), 1), 3)), [false(1, 2), true(1, 6), false(1, 3)]));
at_rest = setfield(data, 'initial_state', 'zero'); % but the model begins later
warns('tokid:simulate', 'the initial states are unknown', @() tokid.simulate(model, at_rest));
warning('off', 'tokid:simulate');
check_against_tool(model, data, 1e-12);
end

function case_periodic_models_go_on()
model = known(7, 3, 2, 2);
for s = 5:7
  names = {'A', 'B', 'C', 'D', 'G'};
  for i = 1:numel(names)
    model.(names{i})(:, :, s) = model.(names{i})(:, :, s - 4);
  end
end
model.period = 4;
model.u_nominal = randn(9, 2);
model.y_nominal = randn(9, 2);
check_against_tool(model, tokid.ensemble(randn(3, 23, 2), [], 'dt', 0.1), 1e-12);
check_against_tool(model, tokid.ensemble(randn(3, 5, 2), [], 'dt', 0.1), 1e-12);
end

function case_nominal_trajectory()
model = known(8, 3, 2, 2);
model.u_nominal = randn(8, 2);
model.y_nominal = randn(8, 2);
check_against_tool(model, tokid.ensemble(randn(3, 8, 2), [], 'dt', 0.1), 1e-12);
check_against_tool(model, tokid.ensemble(randn(3, 12, 2), [], 'dt', 0.1), 1e-12);
end

function case_missing_inputs()
model = known(8, 3, 2, 2);
data = tokid.ensemble(randn(3, 8, 2), [], 'dt', 0.1, 'length', [8 5 0]);
data.u(1, 4, 2) = NaN;
check_against_tool(model, data, 1e-12);
y = tokid.simulate(model, data);
assert(~any(isnan(y(1, 3, :))) && all(isnan(y(1, 4, :))) && all(isnan(y(1, 8, :))) && all(isnan(y(2, 6, :))));
end

function case_mean_initial_state()
model = known(8, 3, 2, 2);
model.initial_state = 'unknown';
model.x0_mean = [1; 2; 3];
model.x0_cov = eye(3);
data = tokid.ensemble(randn(5, 8, 2), [], 'dt', 0.1);
y = warns('tokid:simulate', 'from the mean initial state at step 0', @() tokid.simulate(model, data));
warning('off', 'tokid:simulate');
check_against_tool(model, data, 1e-12);
silent(@() near(tokid.simulate(model, data, 'x0', model.x0_mean), y, 1e-15));
silent(@() near(tokid.simulate(model, data, 'initial_state', 'zero'), ...
                tokid.simulate(model, data, 'x0', zeros(5, 3)), 1e-15));
end

function case_states()
model = known(8, 3, 2, 2);
u = randn(5, 8, 2);
x0 = randn(5, 3);
[y, x] = tokid.simulate(model, u, 'x0', x0);
assert(isequal(size(x), [5, 9, 3]));
near(squeeze(x(:, 1, :)), x0, 0);
for i = 1:5
  state = x0(i, :)';
  for k = 0:7
    input = squeeze(u(i, k + 1, :));
    near(squeeze(x(i, k + 1, :)), state, 1e-13);
    near(squeeze(y(i, k + 1, :)), model.C(:, :, k + 1) * state + model.D(:, :, k + 1) * input, 1e-13);
    state = model.A(:, :, k + 1) * state + model.B(:, :, k + 1) * input;
  end
  near(squeeze(x(i, 9, :)), state, 1e-13);
end
throws('tokid:shape', 'x0: 3 x 5 found, 5 experiments x 3 states needed', @() tokid.simulate(model, u, 'x0', x0'));
end

function case_cells()
model = known(8, 3, 2, 2);
u = {randn(8, 2), randn(5, 2)};
y = tokid.simulate(model, u);
assert(iscell(y) && isequal(size(y{1}), [8, 2]) && isequal(size(y{2}), [5, 2]));
near(y{2}, reshape(tokid.simulate(model, reshape(u{2}, [1, 5, 2])), 5, 2), 1e-15);
end

function case_estimated_states()
data = tokid.example_data('rotating-tube', 'experiments', 30, 'steps', 15, 'initial_state', 'unknown');
model = warns('tokid:identify', 'the model begins at step', @() tokid.identify(data, 'lags', 2, 'states', 2));
y = tokid.simulate(model, data, 'estimate_state', true);
seen = ~isnan(y);
assert(nnz(seen) >= 30 * 12 && max(abs(y(seen) - data.y(seen))) < 1e-6 * max(abs(data.y(:))));
throws('tokid:shape', 'y: none found', @() tokid.simulate(model, data.u, 'estimate_state', true));
end

function case_differences_are_told()
model = known(8, 3, 2, 2);
model.input_names = {'a'; 'b'};
u = randn(5, 8, 2);
silent(@() tokid.simulate(model, u));
warns('tokid:simulate', 'the model gives no output at any step of the data', @() tokid.simulate(model, nan(5, 8, 2)));
warns('tokid:simulate', 'dt = 0.2 s differs from the model''s dt = 0.1 s', @() tokid.simulate(model, u, 'dt', 0.2));
warns('tokid:simulate', 'inputs are named a, c, the model''s a, b', ...
      @() tokid.simulate(model, u, 'input_names', {'a', 'c'}));
throws('tokid:shape', 'inputs: 1 found, the model has 2', @() tokid.simulate(model, u(:, :, 1)));
throws('tokid:option', 'simulate: option ''x'' found', @() tokid.simulate(model, u, 'x', 1));
throws('tokid:model', 'the field C, D, state_dim is missing', @() tokid.simulate(struct('A', 1, 'B', 1), u));
end

function case_torn_models_are_told()
model = known(8, 3, 2, 2);
u = randn(5, 8, 2);
wrong = {'A', model.A(:, :, 1:5), 'model: B: 3 x 2 x 8 found, 3 x 2 x 5 needed beside A of 3 x 3 x 5'; ...
         'A', 'x', 'model: A: 1 x 1 of class char found'; 'C', {1}, 'model: C: 1 x 1 of class cell'; ...
         'D', 1i * model.D, 'model: D: 2 x 2 x 8 of class double found, real'; ...
         'D', zeros(2, 1, 8), 'model: D: 2 x 1 x 8 found'; ...
         'state_dim', model.state_dim(1:4), 'model: state_dim: 4 numbers found, 9 needed'; ...
         'state_dim', 4 * ones(9, 1), 'model: state_dim: whole numbers from 0 to 3'; ...
         'state_dim', 2.5 * ones(9, 1), 'model: state_dim: whole'; ...
         'state_dim', nan(9, 1), 'model: state_dim: whole'; ...
         'dt', 0, 'model: dt: 0 found'; 'dt', 'x', 'model: dt: 1 x 1 of class char'; ...
         'k_begin', -1, 'model: k_begin: -1 found'; 'period', [1 2], 'model: period: [1 2] found'; ...
         'u_nominal', ones(8, 3), 'model: u_nominal: 8 x 3 found, T x 2'; ...
         'y_nominal', 'x', 'model: y_nominal: 1 x 1 of class char'};
for i = 1:size(wrong, 1)
  torn = setfield(model, wrong{i, 1}, wrong{i, 2});
  throws('tokid:model', wrong{i, 3}, @() tokid.simulate(torn, u));
end
names = {'A', 'B', 'C', 'D'};
for i = 1:4
  torn = model;
  torn.(names{i})(1, 1, 3) = NaN;
  throws('tokid:model', [names{i}, '(:, :, 3) is not finite'], @() tokid.simulate(torn, u));
end
throws('tokid:shape', 'x0: a value of class cell', @() tokid.simulate(model, u, 'x0', {1}));
throws('tokid:shape', 'x0: a value of class char', @() tokid.simulate(model, u, 'x0', 'abc'));
whole = model;
whole.B = int8(10 * model.B);
whole.state_dim = int32(model.state_dim);
model.B = double(whole.B);
near(tokid.simulate(whole, u), tokid.simulate(model, u), 1e-15);
throws('tokid:input', 'u: none found, the arguments are (model, u, ...)', @() tokid.simulate(model));
throws('tokid:input', 'contents: none found', @() tokid.write('a.npz'));
throws('tokid:input', 'model: none found', @() tokid.report('a.html'));
names = {'simulate', 'to_ss', 'predict', 'validate', 'confidence', 'modes', 'refine', 'report', 'update', 'read', ...
         'write', 'example_data', 'ensemble'};
for i = 1:numel(names)
  throws('tokid:input', 'none found', @() feval(['tokid.', names{i}]));
end

end

function case_no_tool_is_needed()
setenv('TOKID', '/no/such/tool');
model = known(8, 3, 2, 2);
assert(isequal(size(tokid.simulate(model, randn(5, 8, 2))), [5, 8, 2]));
data = tokid.ensemble(randn(5, 8, 2), randn(5, 8, 2), 'dt', 0.1);
throws('tokid:option', 'option ''estimate_state'': true or false', ...
       @() tokid.simulate(model, data, 'estimate_state', 'yes'));
throws('tokid:option', 'initial_state: ''auto''', @() tokid.simulate(model, data, 'initial_state', 'auto'));
throws('tokid:shape', 'length: 99 found', @() tokid.simulate(model, data, 'length', 99 * ones(5, 1)));
throws('tokid:option', 'neither with ''x0''', ...
       @() tokid.simulate(model, data, 'estimate_state', 1, 'x0', [0 0 0]));
try
  [~, x] = tokid.simulate(model, data, 'estimate_state', true); %#ok<ASGLU>
catch problem
end
assert(strcmp(problem.identifier, 'tokid:option'), problem.message);
silent(@() tokid.simulate(model, data, 'estimate_state', false));
silent(@() tokid.simulate(model, data, 'dt', []));
end

function case_predictions_obey_their_equations()
model = known(9, 3, 2, 2);
u = randn(4, 9, 2);
y = randn(4, 9, 2);
for horizon = [1, 3]
  predicted = tokid.predict(model, u, y, 'horizon', horizon);
  for i = 1:4
    x = zeros(3, 10);
    input = squeeze(u(i, :, :))';
    for s = 1:9
      expected = model.C(:, :, s) * x(:, s) + model.D(:, :, s) * input(:, s);
      x(:, s + 1) = model.A(:, :, s) * x(:, s) + model.B(:, :, s) * input(:, s) ...
                    - model.G(:, :, s) * (squeeze(y(i, s, :)) - expected);
    end
    for s = 1:9
      ahead = x(:, max(1, s - horizon + 1));
      for j = max(1, s - horizon + 1):s - 1
        ahead = model.A(:, :, j) * ahead + model.B(:, :, j) * input(:, j);
      end
      near(squeeze(predicted(i, s, :)), model.C(:, :, s) * ahead + model.D(:, :, s) * input(:, s), 1e-12);
    end
  end
end
end

function case_predictions_are_those_of_the_tool()
data = tokid.example_data('rotating-tube', 'experiments', 30, 'steps', 15, 'initial_state', 'unknown');
model = warns('tokid:identify', 'the model begins at step', @() tokid.identify(data, 'lags', 2, 'states', 2));
tokid.write('model.npz', model);
tokid.write('data.npz', data);
expected = by_tool('predict', 'model.npz', 'data.npz', '--horizon', '2', 'predicted.mat');
assert(isequaln(tokid.predict(model, data, 'horizon', 2), expected.y));
assert(isequaln(tokid.predict('model.npz', 'data.npz', 'horizon', 2), expected.y));
cells = tokid.predict(model, {data.u(1, :)', data.u(2, 1:9)'}, {data.y(1, :)', data.y(2, 1:9)'}, 'horizon', 2, ...
                      'initial_state', 'unknown');
assert(isequal(size(cells{2}), [9, 1]) && isequaln(cells{1}, expected.y(1, :)'));
throws('tokid:option', 'option ''horizon'': ''0'' found', @() tokid.predict(model, data, 'horizon', 0));
throws('tokid:input', 'data: inputs: 2 found, the model has 1', @() tokid.predict(model, ones(3, 15, 2), ones(3, 15)));
end
