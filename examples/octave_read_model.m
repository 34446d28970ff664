% A model out of a .mat, simulated by ten lines of Octave or MATLAB that need nothing of tokid, beside what the tool
% says.
%
%   tokid example oscillator -o data.mat --experiments 60 --steps 40 --process-noise 0.02 --measurement-noise 0.05
%   tokid identify data.mat -o model.mat
%   tokid example oscillator -o fresh.mat --experiments 20 --steps 40 --seed 2
%   tokid simulate model.mat fresh.mat -o simulated.mat
%   octave-cli octave_read_model.m
%
% (A model with a nominal trajectory, which this one has not, wants u_nominal taken from u and y_nominal added to y.)

% SPDX-License-Identifier: BSD-3-Clause

model = load('model.mat');
data = load('fresh.mat');
[N, T, r] = size(data.u);
y = nan(N, T, size(model.C, 1));
x = zeros(size(model.A, 1), N);
for s = 1:size(model.A, 3)  % step k = model.k_begin + s - 1, whose samples are the (k+1)-th
  u = reshape(data.u(:, model.k_begin + s, :), N, r)';
  y(:, model.k_begin + s, :) = permute(model.C(:, :, s) * x + model.D(:, :, s) * u, [2, 3, 1]);
  x = model.A(:, :, s) * x + model.B(:, :, s) * u;
end

expected = load('simulated.mat');
fprintf('%d experiments of %d steps, %d states\n', N, T, size(model.A, 1));
fprintf('largest difference from the tool: %.1e of the largest output\n', ...
        max(abs(y(:) - expected.y(:))) / max(abs(expected.y(:))));
