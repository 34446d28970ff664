function evidence = validate(model, varargin)
% TOKID.VALIDATE  How good a model is on data: fits, and tests of its innovations.
%
%   tokid.validate(model, u, y)                  shows the tool's report in the command window
%   evidence = tokid.validate(model, u, y)
%   evidence = tokid.validate(model, data, 'horizon', 10)
%   evidence = tokid.validate('model.npz', 'fresh.npz', 'cross_validate', 5)
%
% The evidence is what 'tokid validate --json' prints: simulation_fit, one_step_fit and horizon_fit of each output [%],
% errors in the units of the outputs, whiteness_p, nis and more (docs/formats.md). What is not known is [] or NaN.
% evidence.verdict has the conclusion as texts: trust, summary and reasons. Numbers of experiments, outputs and steps
% count from 0, as in outlying_samples: run experiment+1, output output+1, samples steps+1. A fit is relative to the
% departures from y_nominal, or without it to those from one mean: compare models by simulation_rmse and one_step_rmse.
% Model and data may be the names of files. What can be said of data: see tokid.ensemble. Options:
%   'horizon'             steps ahead that outputs are predicted (default 1)
%   'from'                first step of the fits, to compare models that begin at different steps (default 0)
%   'cross_validate'      K: also identify anew from all but one of K parts of the data at a time
%   'inputs', 'outputs'   columns of a .csv
%
% Warnings have the identifier tokid:validate; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
given = {'', 'model', 'model', model; '', 'data', 'data', []};
options = 'horizon from cross_validate inputs:list outputs:list';
call = tokid.internal.take('validate', given, options, varargin);
call.said.print = nargout == 0;
found = tokid.internal.run(call, 1);
if nargout > 0
  evidence = found;
end
end
