function [model, evidence] = identify(varargin)
% TOKID.IDENTIFY  A time varying model from repeated experiments.
%
%   model = tokid.identify(u, y)
%   model = tokid.identify(u, y, 'dt', 0.01, 'hold_out', 0.2, ...)
%   model = tokid.identify(data, ...)       data of tokid.ensemble or tokid.read
%   model = tokid.identify(z, ...)          an iddata object
%   model = tokid.identify('data.h5', ...)  a file: .mat, .npz, .h5 or .csv
%   [model, evidence] = tokid.identify(...)
%
% u is N x T x r and y is N x T x m: N experiments of T steps with r inputs and m outputs, NaN where a sample is
% missing; or cells of T_i x r and T_i x m. tokid.ensemble has the details, and what can be said of the data by name and
% value: 'dt', 'length', 'free_y', 'input_names', 'output_names', 'input_units', 'output_units', 'experiment_names'.
%
% The model is a struct with the fields of the file: A(:,:,s) is n x n and leads from step k to k+1, where
% k = k_begin + s - 1 and step 0 is the first sample; B n x r x S, C m x n x S, D m x r x S, the gain of the observer
% G n x m x S, and more: see docs/formats.md in the source or on the site of tokid. With a nominal trajectory (fields
% u_nominal and y_nominal), u and y stand for the departures from it. The observer at step k is
%
%   e = y - (C*x + D*u);    x = A*x + B*u - G*e;    note the minus: A + G*C is the closed loop
%
% G = -A*K with the gain K of the Kalman filter. The K of n4sid and ssest is -G.
%
% The evidence is what 'tokid identify --json' prints, as a struct: why the orders were chosen, fits, tests, conditions.
% evidence.verdict has the conclusion: trust, summary and reasons, as texts. Numbers of experiments (rows), outputs and
% steps in the evidence count from 0: run i+1, y(:, :, output+1), sample k+1. The
% evidence.method is 'em' after a refinement.
%
% Options are those of the tool, with _ for -; docs/explanation/methods.md explains them:
%   'states', 'lags'      n and p, or 'auto'
%   'method'              'auto', 'tvera', 'subspace' or 'regression'
%   'smoothing'           lambda, Inf for one model, or 'auto'
%   'feedthrough'         true, false (D = 0 is known) or 'auto': by a test where the data are noisy
%   'time_invariant'      true: one model for all steps
%   'period'              P: steps k, k+P, ... share one model
%   'jumps'               steps from which on the matrices are others, 'none' or 'auto'
%   'delays'              steps of dead time of each input, 'none' or 'auto'
%   'refine'              true, false or 'auto': maximum likelihood as far as it helps
%   'weighting'           'auto', 'one-step', 'many-steps' or 'projection'
%   'output_weights'      a number from 0 on for each output that matters more or less, or 'equal'
%   'horizons'            steps ahead of the predictions whose errors decide, from 1 on
%   'initial_state'       'auto', 'zero' or 'unknown'
%   'frame'               'raw', 'reference' or 'smooth'; 'reference_step': its step
%   'nominal'             'auto', 'none' or 'mean'
%   'hold_out'            share of the experiments that is kept for the fit
%   'outliers'            'keep', 'drop' or 'downweight': experiments and samples that do not fit
%   'rows', 'cols'        blocks of the Hankel matrices of tvera, or 'auto'
%   'threads'             0 for all of the machine
%   'report'              name of an .html to write: the page that shows whether to trust the model
%   'state'               name of a state to write for tokid.update
%   'block'               steps of an .h5 in memory at a time
%   'inputs', 'outputs'   columns of a .csv
%   'print'               true: show the tool's report in the command window. The result evidence must be left out
%
% Warnings have the identifier tokid:identify. Errors: tokid:shape (arrays), tokid:option (options), tokid:input
% (unusable data or files), tokid:failed (the computation), tokid:toolNotFound, tokid:tool.
%
% Example:
%   data = tokid.example_data('oscillator', 'experiments', 60, 'steps', 40);
%   [model, evidence] = tokid.identify(data.u, data.y, 'dt', data.dt, 'initial_state', 'zero');
%   y = tokid.simulate(model, data.u);

% SPDX-License-Identifier: BSD-3-Clause

given = {'', 'data', 'data', []; '-o', 'new', 'model.mat', []};
options = ['states lags method smoothing feedthrough:switch time_invariant:flag period jumps:list ' ...
           'delays:list refine:switch weighting output_weights:list horizons:list initial_state frame ' ...
           'reference_step nominal hold_out outliers rows cols threads block print:own ' ...
           'report:file state:file inputs:list outputs:list'];
call = tokid.internal.take('identify', given, options, varargin);
if ischar(call.given{1, 4})
  call.given{2, 3} = 'model.h5'; % The tool writes no other format if it reads a large .h5 in blocks.
end
[evidence, model] = tokid.internal.run(call, nargout);
end
