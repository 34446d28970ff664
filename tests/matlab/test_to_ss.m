function test_to_ss(name)
% One step as an object of the control package.

% SPDX-License-Identifier: BSD-3-Clause

pkg load control
feval(name);
end

function model = constant(S)
A = [0.9 0.2 0; -0.2 0.9 0.1; 0 0 0.7];
model = struct('A', repmat(A, [1 1 S]), 'B', repmat([1 0; 0 1; 1 1], [1 1 S]), 'C', repmat([1 0 1; 0 1 0], [1 1 S]), ...
               'D', repmat([0 0.5; 0 0], [1 1 S]), 'G', zeros(3, 2, S), 'state_dim', 3 * ones(S + 1, 1), ...
               'k_begin', 0, 'dt', 0.1, 'period', 1, 'method', 'known');
model.input_names = {'force'; 'torque'};
model.output_names = {'x'; 'phi'};
end

function case_simulates_as_the_control_package_does()
model = constant(5);
sys = tokid.to_ss(model);
u = randn(3, 40, 2);
x0 = randn(3, 3);
y = tokid.simulate(model, u, 'x0', x0);
for i = 1:3
  expected = lsim(sys, squeeze(u(i, :, :)), [], x0(i, :)');
  near(squeeze(y(i, :, :)), expected, 1e-12);
end
end

function case_impulse_responses_are_those_of_the_tool()
model = constant(30);
model.dt = 1; % pulses of the height 1 then have the area 1: versions of the package differ in which of both they take
tokid.write('model.npz', model);
pulses = cat(3, [eye(1, 30); zeros(1, 30)], [zeros(1, 30); eye(1, 30)]);
tokid.write('pulses.npz', tokid.ensemble(pulses, [], 'dt', 1));
pulses = by_tool('simulate', 'model.npz', 'pulses.npz', 'simulated.mat');
expected = impulse(tokid.to_ss(model), 29);
for i = 1:2
  near(squeeze(pulses.y(i, :, :)), expected(:, :, i), 1e-12);
end
end

function case_matrices_names_and_sample_time()
model = constant(5);
model.A(1, 1, 4) = 0.5;
model.period = 0;
model.k_begin = 2;
sys = tokid.to_ss(model, 5);
[A, B, C, D, dt] = ssdata(sys);
assert(isequal(A, model.A(:, :, 4)) && isequal(B, model.B(:, :, 4)) && isequal(C, model.C(:, :, 4)));
assert(isequal(D, model.D(:, :, 4)) && dt == 0.1);
assert(isequal(get(sys, 'inname'), model.input_names) && isequal(get(sys, 'outname'), model.output_names));
throws('tokid:step', 'step 7 found, the model has the steps 2 to 6', @() tokid.to_ss(model, 7));
throws('tokid:step', 'step 2.5 found', @() tokid.to_ss(model, 2.5));
throws('tokid:step', 'a step of class char found', @() tokid.to_ss(model, 'a'));
throws('tokid:step', 'a step of class cell found', @() tokid.to_ss(model, {3}));
throws('tokid:step', 'the model varies in time', @() tokid.to_ss(model));
model.state_dim(2) = 2;
throws('tokid:step', 'step 2 leads from 3 to 2 states', @() tokid.to_ss(model, 2));
end

function case_identified_invariant_model()
data = tokid.ensemble(randn(1, 200, 2), randn(1, 200, 2), 'dt', 0.1);
truth = constant(200);
data.y = tokid.simulate(truth, data.u);
model = tokid.identify(data, 'time_invariant', true, 'initial_state', 'zero');
near(sort(abs(pole(tokid.to_ss(model)))), sort(abs(eig(truth.A(:, :, 1)))), 1e-6);
[~, B] = ssdata(tokid.to_ss(model, 500));
near(B, model.B(:, :, end), 0);
end

function case_without_the_control_package()
pkg unload control
throws('tokid:noControl', 'pkg load control', @() tokid.to_ss(constant(2)));
end
