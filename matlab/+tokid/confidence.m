function [bounds, evidence] = confidence(model, varargin)
% TOKID.CONFIDENCE  Intervals for what a model says: Markov parameters, mean outputs, eigenvalues.
%
%   bounds = tokid.confidence(model, u, y)
%   [bounds, evidence] = tokid.confidence(model, data, 'level', 0.99)
%
% The data are those that the model was identified from, whole. The bounds are a struct: markov(:, :, 1+g, s), m x r,
% is the answer at step k = k_begin + s - 1 to a pulse g steps before, between markov_lower and markov_upper; simulated
% is N x T x m, eigenvalues_real and eigenvalues_imag E x n, with _lower and _upper likewise
% (docs/formats.md). The evidence is what 'tokid confidence --json' prints. What can be said of data: see
% tokid.ensemble. Options:
%   'level'               probability that an interval holds the truth (default 0.95)
%   'replicates', 'seed'  of the bootstrap
%   'band'                Markov parameters up to so many steps apart, or 'auto'
%   'reference_step'      step of the frame of the eigenvalues
%   'threads'             0 for all of the machine
%   'inputs', 'outputs'   columns of a .csv
%
% Warnings have the identifier tokid:confidence; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
given = {'', 'model', 'model', model; '', 'data', 'data', []; '-o', 'new', 'bounds.mat', []};
options = 'level replicates seed band reference_step threads inputs:list outputs:list';
call = tokid.internal.take('confidence', given, options, varargin);
[evidence, bounds] = tokid.internal.run(call);
end
