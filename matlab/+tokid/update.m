function [model, evidence] = update(state, varargin)
% TOKID.UPDATE  Experiments that come later join those of a state, and give the model of all of them.
%
%   tokid.identify(u, y, 'state', 'rig.h5');
%   model = tokid.update('rig.h5', new_u, new_y)
%   [model, evidence] = tokid.update('rig.h5', new_data, ...)
%
% The state, a file, gets the new experiments. Arrays without 'dt' have the sample time of the state. The evidence is
% what 'tokid update --json' prints: among it the fit of the model before, which has not seen them. What can be said of
% data: see tokid.ensemble. Options:
%   'wait'                seconds to wait for another update of the same state (60)
%   'threads'             0 for all of the machine
%   'inputs', 'outputs'   columns of a .csv
%   'print'               true: show the tool's report in the command window. The result evidence must be left out
%
% Warnings have the identifier tokid:update; errors as in tokid.identify.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'state');
given = {'', 'state', 'state', state; '', 'data', 'data', []; '-o', 'new', 'model.mat', []};
options = 'wait threads print:own inputs:list outputs:list';
call = tokid.internal.take('update', given, options, varargin);
[evidence, model] = tokid.internal.run(call, nargout);
end
