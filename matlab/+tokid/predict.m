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
known = {'horizon', 'value'; 'inputs', 'list'; 'outputs', 'list'};
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[file, of_model] = tokid.internal.take_model(folder, model);
[data, pairs, files, lengths] = tokid.internal.take_data(folder, true, varargin, model, {});
words = tokid.internal.options('predict', known, pairs, tokid.internal.data_fields());
computed = fullfile(folder, 'predicted.mat');
tokid.internal.call([{'predict', file, data, '-o', computed}, words], folder, [of_model; files]);
computed = tokid.internal.read_mat(computed);
y = computed.y;
if ~isempty(lengths)
  y = tokid.internal.as_cells(y, lengths);
end
end
