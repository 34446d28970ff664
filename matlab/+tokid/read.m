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
given = {'', 'file', 'file', file; '', 'new', 'copy.mat', []};
call = tokid.internal.take('read', given, 'inputs:list outputs:list', varargin);
[~, contents] = tokid.internal.run(call);
end
