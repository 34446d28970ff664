function [controller, evidence, loop] = lqr(model, varargin)
% TOKID.LQR  A controller of the departures from the nominal trajectory: finite-horizon LQR, or LQG with the observer.
%
%   controller = tokid.lqr(model, 'output_weight', [100 1], 'input_weight', 0.1)
%   [controller, evidence] = tokid.lqr('model.npz', 'input_rate_weight', 0.1, 'begin', 20)
%   [controller, evidence, loop] = tokid.lqr(model, 'reference', wanted, 'experiments', 200, 'u_max', 0.1)
%
% The law is u(k) = u_nominal(k) - controller_gain(k) x(k) - input_gain(k) (u(k-1) - u_nominal(k-1)). x(k) is the state
% that the observer of the model predicts. The fields of the controller are those of the file of 'tokid lqr'
% (docs/formats.md): controller_gain is r x n x S. The field 'model' is there only if the model is the name of a file.
% The evidence has the expected cost. Weights are one number, or one for each channel. loop is an ensemble: experiments
% of the closed loop with the observer, which the tool simulates. The model may be the name of a file. Options:
%   'output_weight', 'input_weight'   of squared outputs and inputs (default 1)
%   'input_rate_weight'   of squared changes of the inputs from step to step (default none)
%   'terminal_weight'     added to the weights of the outputs at the last step (default none)
%   'begin', 'end'        first step, and the step after the last one (default those of the model)
%   'reference'           wanted outputs, T x m (default the nominal trajectory)
% Options of the simulation, only with three results:
%   'truth'               model of the system (default the model)
%   'experiments', 'seed' number of experiments (default 100), seed of their noise (default 1)
%   'no_noise'            true: without noise, from the mean initial state
%   'u_min', 'u_max'      limits of the inputs (default none)
%
% Warnings have the identifier tokid:lqr; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
known = {'output_weight', 'list'; 'input_weight', 'list'; 'input_rate_weight', 'list'; 'terminal_weight', 'list'; ...
         'begin', 'value'; 'end', 'value'; 'reference', 'own'; 'truth', 'own'; 'experiments', 'value'; ...
         'seed', 'value'; 'no_noise', 'flag'; 'u_min', 'list'; 'u_max', 'list'};
[words, own] = tokid.internal.options('lqr', known, varargin);
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[file, files] = tokid.internal.take_model(folder, model);
if isfield(own, 'reference')
  wanted = fullfile(folder, 'wanted.mat');
  y = reshape(own.reference, [1, size(own.reference)]);
  tokid.internal.write_ensemble(wanted, tokid.ensemble(zeros(1, size(y, 2)), y));
  words = [words, {'--reference', wanted}];
  files = [files; {wanted, 'the reference'}];
end
if isfield(own, 'truth')
  [truth, of_truth] = tokid.internal.take_model(folder, own.truth, 'truth');
  words = [words, {'--truth', truth}];
  files = [files; of_truth];
end
simulated = fullfile(folder, 'loop.mat');
if nargout > 2
  words = [words, {'--simulate', simulated}];
end
written = fullfile(folder, 'controller.mat');
output = tokid.internal.call([{'lqr', file, '-o', written, '--json'}, words], folder, files);
controller = tokid.internal.read_mat(written);
if ~isempty(files) && strcmp(files{1, 1}, file) && isfield(controller, 'model')
  controller = rmfield(controller, 'model'); % the name of a temporary file
end
evidence = tokid.internal.decode(output, folder);
if nargout > 2
  loop = tokid.read(simulated);
end
end
