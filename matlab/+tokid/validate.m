function evidence = validate(model, varargin)
% TOKID.VALIDATE  How good a model is on data: fits, and tests of its innovations.
%
%   evidence = tokid.validate(model, u, y)
%   evidence = tokid.validate(model, data, 'horizon', 10)
%   evidence = tokid.validate('model.npz', 'fresh.npz', 'cross_validate', 5)
%
% The evidence is what 'tokid validate --json' prints: simulation_fit, one_step_fit and horizon_fit of each output [%],
% errors in the units of the outputs, whiteness_p, nis and more (docs/formats.md). What is not known is [] or NaN.
% Model and data may be the names of files. What can be said of data: see tokid.ensemble. Options:
%   'horizon'             steps ahead that outputs are predicted (default 1)
%   'from'                first step of the fits, to compare models that begin at different steps (default 0)
%   'cross_validate'      K: also identify anew from all but one of K parts of the data at a time
%   'inputs', 'outputs'   columns of a .csv
%
% Warnings have the identifier tokid:validate; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
known = {'horizon', 'value'; 'from', 'value'; 'cross_validate', 'value'; 'inputs', 'list'; 'outputs', 'list'};
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[file, of_model] = tokid.internal.take_model(folder, model);
[data, pairs, files] = tokid.internal.take_data(folder, true, varargin, model, {});
words = tokid.internal.options('validate', known, pairs, tokid.internal.data_fields());
output = tokid.internal.call([{'validate', file, data, '--json'}, words], folder, [of_model; files]);
evidence = tokid.internal.decode(output, folder);
end
