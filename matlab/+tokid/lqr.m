function [controller, evidence, loop] = lqr(model, varargin)
% TOKID.LQR  A controller of the departures from the nominal trajectory: finite-horizon LQR, or LQG with the observer.
%
%   controller = tokid.lqr(model, 'output_weight', [100 1], 'input_weight', 0.1)
%   [controller, evidence] = tokid.lqr('model.npz', 'input_rate_weight', 0.1, 'begin', 20)
%   [controller, evidence, loop] = tokid.lqr(model, 'reference', wanted, 'experiments', 200, 'u_max', 0.1)
%
% The law is u(k) = u_nominal(k) - controller_gain(k) x(k) - input_gain(k) (u(k-1) - u_nominal(k-1)). There is an
% input_gain only with weights on input rates. With a reference, feedforward(k) is added. x(k) is the state that the
% observer of the model predicts, with the recursion in the help of tokid.identify; docs/matlab.md has the loop as code.
% The fields of the controller are those of the file of 'tokid lqr' (docs/formats.md): controller_gain is r x n x S. The
% field 'model' is there only if the model is the name of a file. The evidence has the expected cost. A weight is one
% number, one for each channel, or a diagonal matrix. loop is an ensemble: experiments of the closed loop with the
% observer, which the tool simulates. The model may be the name of a file. Options:
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
given = {'', 'model', 'model', model; '-o', 'new', 'controller.mat', []};
options = ['output_weight:weight input_weight:weight input_rate_weight:weight ' ...
           'terminal_weight:weight begin end reference:reference ' ...
           'truth:model experiments seed no_noise:flag u_min:list u_max:list'];
call = tokid.internal.take('lqr', given, options, varargin);
of_loop = intersect(fieldnames(call.said), {'truth', 'experiments', 'seed', 'no_noise', 'u_min', 'u_max'});
if nargout > 2
  call.given(end + 1, :) = {'--simulate', 'new', 'loop.mat', []};
elseif ~isempty(of_loop)
  error('tokid:option', ['lqr: option ''%s'' found, but not the third result, loop. The option belongs to its ' ...
                         'simulation: [controller, evidence, loop] = tokid.lqr(...)'], of_loop{1});
end
[evidence, controller, loop] = tokid.internal.run(call);
if isstruct(model) && isfield(controller, 'model')
  controller = rmfield(controller, 'model'); % the name of a temporary file
end
end
