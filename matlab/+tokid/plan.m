function [data, evidence] = plan(varargin)
% TOKID.PLAN  How many experiments to make, and inputs for them.
%
%   data = tokid.plan('states', 4, 'inputs', 2, 'outputs', 2, 'steps', 80, 'amplitude', 0.5)
%   [data, evidence] = tokid.plan('model', model, ...)
%
% data.u holds the inputs, N x T x r. The evidence is what 'tokid plan --json' prints: minimum, recommended, reasons,
% condition and more (docs/formats.md). Options:
%   'states', 'inputs', 'outputs', 'steps'   n, r, m, T; with a model: as it has
%   'lags', 'experiments'                    p and N, or 'auto'
%   'kind'           'orthogonal', 'gaussian', 'binary', 'multisine' or 'optimised'
%   'amplitude'      limit of |u|, one for all inputs, or one for each (default 1)
%   'noise'          standard deviations of the noise on inputs and outputs: [0.1 0.2]
%   'model'          a preliminary model, or the name of its file
%   'initial_state'  'zero' or 'unknown'
%   'nominal'        true: the experiments depart from a mean motion
%   'dt', 'seed', 'threads'
%
% Warnings have the identifier tokid:plan; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

options = ['states inputs outputs steps lags experiments kind amplitude:list noise:pair model:model ' ...
           'initial_state nominal:flag dt seed threads'];
call = tokid.internal.take('plan', {'-o', 'new', 'inputs.mat', []}, options, varargin);
[evidence, data] = tokid.internal.run(call);
end
