function y = predict(model, varargin)
% TOKID.PREDICT  Outputs with the observer in the loop.
%
%   predicted = tokid.predict(model, u, y)
%   predicted = tokid.predict(model, data, 'horizon', 10)
%   predicted = tokid.predict('model.npz', 'fresh.npz')
%
% predicted(i, k+1, :) is what the model expects at step k of experiment i, from the outputs up to step k - horizon and
% the inputs up to step k: N x T x m, or cells where u and y are cells. NaN where the model has no step, or where it
% doesn't know the state yet. Unknown initial states are estimated, and missing samples bridged, by the tool. Model and
% data may be the names of files. What can be said of data: see tokid.ensemble. Options:
%   'horizon'             steps ahead (default 1)
%   'inputs', 'outputs'   columns of a .csv
%
% Warnings have the identifier tokid:predict; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
given = {'', 'model', 'model', model; '', 'data', 'data', []; '-o', 'new', 'predicted.mat', []};
call = tokid.internal.take('predict', given, 'horizon inputs:list outputs:list', varargin);
[~, predicted] = tokid.internal.run(call);
y = tokid.internal.as_cells(predicted.y, call.lengths);
end
