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
known = {'output_weight', 'list'; 'input_weight', 'list'; 'input_rate_weight', 'list'; 'terminal_weight', 'list'; ...
         'begin', 'value'; 'end', 'value'; 'reference', 'own'; 'truth', 'own'; 'experiments', 'value'; ...
         'seed', 'value'; 'no_noise', 'flag'; 'u_min', 'list'; 'u_max', 'list'};
[words, own] = tokid.internal.options('lqr', known, diagonals(varargin));
if nargout < 3
  of_loop = intersect(cellfun(@(i) tokid.internal.option_name(varargin, i), num2cell(1:2:numel(varargin)), ...
                              'UniformOutput', false), ...
                      {'truth', 'experiments', 'seed', 'no_noise', 'u_min', 'u_max'});
  if ~isempty(of_loop)
    error('tokid:option', ['lqr: option ''%s'' found, but not the third result, loop. The option belongs to its ' ...
                           'simulation: [controller, evidence, loop] = tokid.lqr(...)'], of_loop{1});
  end
end
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

function pairs = diagonals(pairs)
% A diagonal matrix of weights is given to the tool as its diagonal.
names = {'output_weight', 'input_weight', 'input_rate_weight', 'terminal_weight'};
for i = 1:2:numel(pairs) - 1
  name = tokid.internal.option_name(pairs, i);
  value = pairs{i + 1};
  if ~any(strcmp(name, names)) || ~isnumeric(value) || isvector(value) || isempty(value)
    continue
  elseif ndims(value) > 2 || size(value, 1) ~= size(value, 2) || any(any(value ~= diag(diag(value)))) %#ok<ISMAT>
    error('tokid:option', ['lqr: option ''%s'': a value of size %s found; one number, one number for each channel ' ...
                           'or a diagonal matrix needed. Python and C++ take full matrices and weights for each ' ...
                           'step'], ...
          name, mat2str(size(value)));
  end
  pairs{i + 1} = full(diag(value));
end
end
