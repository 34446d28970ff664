function evidence = export(source, model, varargin)
% TOKID.EXPORT  The observer of a model as C99 source, and with it a controller.
%
%   evidence = tokid.export('observer.c', model)
%   evidence = tokid.export('observer.c', model, 'controller', tokid.lqr(model), 'float', true)
%   evidence = tokid.export('observer.c', 'model.npz', 'controller', 'controller.h5', 'name', 'crane')
%
% It writes the source and, beside it, the header observer.h. docs/how-to/deploy.md in the source or on the site of
% tokid shows how to call them. The evidence counts bytes and operations (docs/formats.md). The model may be the name of
% a file. Options:
%   'controller'          of this model, from tokid.lqr or the name of a file (default none)
%   'float'               true: numbers of type float (default double)
%   'name'                beginning of all names in C (default that of the file)
%   'start_from_zero'     true: start from the zero state if the initial state is unknown
%
% Warnings have the identifier tokid:export; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'source', 'model');
given = {'', 'model', 'model', model; '-o', 'file', 'source', source};
options = 'controller:controller float:flag name start_from_zero:flag';
call = tokid.internal.take('export', given, options, varargin);
evidence = tokid.internal.run(call);
end
