function write(file, contents, varargin)
% TOKID.WRITE  Writes a model or an ensemble: .mat, .npz, .h5, and .csv for ensembles.
%
%   tokid.write('model.npz', model)
%   tokid.write('data.h5', tokid.ensemble(u, y, 'dt', 0.01))
%
% The file appears whole or not at all. Options:
%   'mat73'   true: a .mat of version 7.3, which arrays beyond 2 GiB need
%
% Errors: tokid:input (the file can't be written, or the contents are no model or ensemble), tokid:shape, tokid:model,
% tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'file', 'contents');
kind = 'data';
if isstruct(contents) && isfield(contents, 'A')
  kind = 'model';
end
given = {'', kind, kind, contents; '', 'file', 'file', file};
call = tokid.internal.take('write', given, 'mat73:flag', varargin);
tokid.internal.run(call);
end
