function [model, evidence] = refine(model, varargin)
% TOKID.REFINE  Maximum likelihood by EM, from a model on.
%
%   model = tokid.refine(model, u, y)
%   model = tokid.refine(model, data, ...)
%   [model, evidence] = tokid.refine(model, 'data.h5', ...)
%
% The refined model has the covariances of the noise (Q, R), the gains of the Kalman filter (K, G) and, where initial
% states are unknown, their mean and covariance. Model and data may be the names of files. The evidence is what
% 'tokid refine --json' prints. What can be said of data: see tokid.ensemble. Options:
%   'smoothing'           lambda, Inf for one model, or 'auto'
%   'period'              P: steps k, k+P, ... share one model, 1: all steps
%   'feedthrough'         true, false (D = 0 is known) or 'auto': as the model was identified
%   'iterations'          at most so many (default 60)
%   'initial_state'       'auto', 'zero' or 'unknown'
%   'threads'             0 for all of the machine
%   'inputs', 'outputs'   columns of a .csv
%   'print'               true: show the tool's report in the command window. The result evidence must be left out
%
% Warnings have the identifier tokid:refine; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
given = {'', 'model', 'model', model; '', 'data', 'data', []; '-o', 'new', 'model.mat', []};
options = ['smoothing period feedthrough:switch iterations initial_state threads print:own ' ...
           'inputs:list outputs:list'];
call = tokid.internal.take('refine', given, options, varargin);
[evidence, model] = tokid.internal.run(call, nargout);
end
