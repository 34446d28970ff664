function test_control(name)
% Controllers and learning, against the tool and against their equations.

% SPDX-License-Identifier: BSD-3-Clause

feval(name);
end

function [model, data] = identified()
data = tokid.example_data('oscillator', 'experiments', 40, 'steps', 20);
model = tokid.identify(data, 'states', 4, 'lags', 2);
end

function case_controller_of_the_tool()
[model, ~] = identified();
tokid.write('model.npz', model);
expected = by_tool('lqr', 'model.npz', '--output-weight', '3,2', '--input-weight', '0.5', '--input-rate-weight', '0.25', ...
                   '--begin', '4', 'controller.mat');
[controller, evidence] = tokid.lqr(model, 'output_weight', [3 2], 'input_weight', 0.5, 'input_rate_weight', 0.25, ...
                                   'begin', 4);
assert(isequal(controller.controller_gain, expected.controller_gain));
assert(isequal(size(controller.controller_gain, 3), 16) && controller.k_begin == 4);
assert(evidence.begin == 4 && evidence.expected_cost.total > 0);
assert(strcmp(expected.model, 'model.npz') && ~isfield(controller, 'model'));
named = tokid.lqr('model.npz');
assert(strcmp(named.model, 'model.npz'));
throws('tokid:option', 'option ''Weight'' found', @() tokid.lqr(model, 'Weight', 1));
throws('tokid:option', 'option ''output_weight'': 3 numbers found', @() tokid.lqr(model, 'output_weight', [1 2 3]));
end

function case_closed_loop_of_the_tool()
[model, ~] = identified();
wanted = tokid.example_data('oscillator', 'experiments', 1, 'steps', 20, 'seed', 3);
reference = reshape(wanted.y, 20, 2);
tokid.write('model.npz', model);
tokid.write('wanted.npz', wanted);
expected = by_tool('lqr', 'model.npz', '--output-weight', '30', '--reference', 'wanted.npz', 'controller.mat');
[controller, evidence, loop] = tokid.lqr(model, 'output_weight', 30, 'reference', reference, 'experiments', 7, ...
                                         'u_max', [0.3 0.4], 'no_noise', true);
near(controller.feedforward, expected.feedforward, 1e-12);
assert(isequal(size(loop.u), [7 20 2]) && max(max(loop.u(:, :, 1))) <= 0.3 && max(max(loop.u(:, :, 2))) <= 0.4);
assert(numel(evidence.simulation.cost) == 7 && isempty(evidence.simulation.truth));
[~, evidence, other] = tokid.lqr(model, 'output_weight', 30, 'reference', reference, 'truth', 'model.npz', ...
                                 'experiments', 7, 'u_max', [0.3 0.4], 'no_noise', true);
assert(isequal(other.y, loop.y) && strcmp(evidence.simulation.truth, 'model.npz'));
throws('tokid:input', 'the reference: 19 steps found', @() tokid.lqr(model, 'reference', reference(1:19, :)));
throws('tokid:option', 'option ''experiments'' found, but not the third result', ...
       @() tokid.lqr(model, 'experiments', 7));
end

function case_source_of_the_tool()
[model, ~] = identified();
controller = tokid.lqr(model, 'input_weight', 0.5);
tokid.write('model.npz', model);
save('-v6', 'controller.mat', '-struct', 'controller');
evidence = tokid.export('by_value.c', model, 'controller', controller, 'float', true, 'name', 'crane');
assert(strcmp(evidence.name, 'crane') && strcmp(evidence.precision, 'float') && evidence.stored_steps > 0);
assert(evidence.operations_control.multiplications > 0);
by_name = tokid.export('by_name.c', 'model.npz', 'controller', 'controller.mat', 'float', true, 'name', 'crane');
assert(by_name.table_bytes == evidence.table_bytes);
header = fileread('by_value.h');
assert(~isempty(strfind(header, 'crane_step')) && ~isempty(strfind(header, 'crane_control')));
assert(strcmp(strrep(header, 'by_value', 'by_name'), fileread('by_name.h')));
assert(strcmp(strrep(fileread('by_value.c'), 'by_value', 'by_name'), fileread('by_name.c')));
alone = tokid.export('observer.c', model);
assert(isempty(alone.operations_control) && strcmp(alone.precision, 'double') && strcmp(alone.name, 'observer'));
assert(isempty(strfind(fileread('observer.h'), 'observer_control')));
throws('tokid:option', 'option ''single'' found', @() tokid.export('a.c', model, 'single', true));
throws('tokid:input', 'a.txt', @() tokid.export('a.txt', model));
throws('tokid:input', 'the name of a file needed', @() tokid.export('a.c', model, 'controller', 3));
throws('tokid:input', 'model', @() tokid.export('a.c'));
assert(~exist('a.c', 'file') && ~exist('a.h', 'file'));
end

function case_learning_follows_the_reference()
% Without noise, and nearly without a weight on the inputs, one run suffices.
[model, data] = identified();
wanted = tokid.example_data('oscillator', 'experiments', 1, 'steps', 20, 'seed', 3);
reference = reshape(wanted.y, 20, 2);
u = zeros(20, 2);
y = reshape(tokid.simulate(model, reshape(u, 1, 20, 2)), 20, 2);
next = tokid.learn(model, reference, u, y, 'input_change_weight', 1e-9);
assert(all(next.predicted_error < 1e-3 * next.error));
near(reshape(tokid.simulate(model, reshape(next.u, 1, 20, 2)), 20, 2), next.predicted, 1e-9);
near(sqrt(mean((reference - y) .^ 2))', next.error(:), 1e-12);
reference(1:3, :) = NaN;
next = tokid.learn(model, reference, u, y, 'input_weight', 1, 'error_weight', [1 2]);
assert(all(isfinite(next.u(:))));
throws('tokid:shape', 'reference [19 2]', @() tokid.learn(model, reference(1:19, :), u, y, 'input_weight', 1));
throws('tokid:input', 'no weight on inputs found', @() tokid.learn(model, reference, u, y));
throws('tokid:input', 'y: none found', @() tokid.learn(model, reference, u));
end

function case_weights_as_matrices()
[model, ~] = identified();
expected = tokid.lqr(model, 'output_weight', [3 2], 'input_weight', 0.5);
found = tokid.lqr(model, 'Output_Weight', diag([3 2]), 'input_weight', 0.5);
assert(isequal(found.controller_gain, expected.controller_gain));
throws('tokid:option', 'option ''output_weight'': a value of size [2 2] found; one number, one number for each', ...
       @() tokid.lqr(model, 'output_weight', [3 1; 1 2]));
throws('tokid:option', 'option ''input_weight'': a value of size [2 2 20] found', ...
       @() tokid.lqr(model, 'input_weight', repmat(eye(2), [1 1 20])));
end
