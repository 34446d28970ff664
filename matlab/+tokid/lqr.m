function [controller, evidence] = lqr(model, varargin)
% TOKID.LQR  A controller of the departures from the nominal trajectory: finite-horizon LQR, or LQG with the observer.
%
%   controller = tokid.lqr(model, 'output_weight', [100 1], 'input_weight', 0.1)
%   [controller, evidence] = tokid.lqr('model.npz', 'input_rate_weight', 0.1, 'begin', 20)
%
% The law is u(k) = u_nominal(k) - controller_gain(k) x(k) - input_gain(k) (u(k-1) - u_nominal(k-1)). x(k) is the state
% that the observer of the model predicts. The fields of the controller are those of the file of 'tokid lqr'
% (docs/formats.md): controller_gain is r x n x S. The evidence has the expected cost. Weights are one number, or one
% for each channel. The model may be the name of a file. Options:
%   'output_weight', 'input_weight'   of squared outputs and inputs (default 1)
%   'input_rate_weight'   of squared changes of the inputs from step to step (default none)
%   'terminal_weight'     added to the weights of the outputs at the last step (default none)
%   'begin', 'end'        first step, and the step after the last one (default those of the model)
%
% Warnings have the identifier tokid:lqr; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
known = {'output_weight', 'list'; 'input_weight', 'list'; 'input_rate_weight', 'list'; 'terminal_weight', 'list'; ...
         'begin', 'value'; 'end', 'value'};
words = tokid.internal.options('lqr', known, varargin);
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[file, of_model] = tokid.internal.take_model(folder, model);
written = fullfile(folder, 'controller.mat');
output = tokid.internal.call([{'lqr', file, '-o', written, '--json'}, words], folder, of_model);
controller = tokid.internal.read_mat(written);
evidence = tokid.internal.decode(output, folder);
end
