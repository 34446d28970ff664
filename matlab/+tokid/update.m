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
known = {'wait', 'value'; 'threads', 'value'; 'print', 'own'; 'inputs', 'list'; 'outputs', 'list'};
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[data, pairs, files] = tokid.internal.take_data(folder, true, varargin, {state}, {});
[words, own] = tokid.internal.options('update', known, pairs, tokid.internal.data_fields());
file = fullfile(folder, 'new_model.mat');
files(end + 1, :) = {file, 'model'};
evidence = tokid.internal.run([{'update', tokid.internal.file_name(state), data, '-o', file}, words], folder, files, ...
                              own, nargout > 1);
model = tokid.internal.read_mat(file);
end
