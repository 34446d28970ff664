function contents = read(file, varargin)
% TOKID.READ  A model or an ensemble out of a file: .mat, .npz, .h5 or .csv.
%
%   model = tokid.read('model.npz')
%   data = tokid.read('data.csv', 'inputs', {'torque'}, 'outputs', {'angle', 'rate'})
%
% A model is a struct of A (n x n x S), B (n x r x S), ..., as tokid.identify gives it; an ensemble one of u (N x T x
% r), y (N x T x m), ..., as tokid.ensemble does. Options:
%   'inputs', 'outputs'   columns of a .csv
%
% Errors: tokid:input (the file is absent, damaged or something else), tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'file');
words = tokid.internal.options('read', {'inputs', 'list'; 'outputs', 'list'}, varargin);
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
copy = fullfile(folder, 'copy.mat');
tokid.internal.call([{'convert', tokid.internal.file_name(file), copy}, words], folder, cell(0, 2));
contents = tokid.internal.read_mat(copy);
if isfield(contents, 'experiments')
  contents = rmfield(contents, 'experiments');
end
end
