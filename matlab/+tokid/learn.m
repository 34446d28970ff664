function next = learn(model, reference, u, y, varargin)
% TOKID.LEARN  The inputs of the next run from a reference and the last run: norm-optimal iterative learning.
%
%   next = tokid.learn(model, reference, u, y, 'input_change_weight', 0.01)
%
% reference and y are T x m, u is T x r: the wanted outputs, and inputs and outputs of the last run. NaN marks an output
% that is free, or a missing sample. next.u (T x r) are the inputs of the next run, next.predicted (T x m) its outputs as
% the model expects them. next.error and next.predicted_error are the RMS of reference minus output of each output, in
% the last run and in the next one. All runs begin from the same state. Weights are one number, or one for each channel;
% one of those on inputs is needed. The model may be the name of a file. Options:
%   'error_weight'          of squared errors (default 1)
%   'input_weight'          of squared inputs, as departures from the nominal trajectory
%   'input_change_weight'   of squared changes of the inputs from the last run
%   'input_rate_weight'     of squared changes of the inputs from step to step
%
% Warnings have the identifier tokid:learn; errors as in tokid.identify, and tokid:model, tokid:shape.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model', 'reference', 'u', 'y');
if ~isequal(size(reference), size(y)) || size(u, 1) ~= size(y, 1) || ndims(u) > 2 || ndims(y) > 2
  error('tokid:shape', 'learn: reference %s, u %s and y %s found, T x m, T x r and T x m needed', ...
        mat2str(size(reference)), mat2str(size(u)), mat2str(size(y)));
end
last = struct('u', reshape(u, [1, size(u)]), 'y', reshape(y, [1, size(y)]));
given = {'', 'model', 'model', model; ...
         '', 'data', 'the last run', last; ...
         '', 'reference', 'the reference', reference; ...
         '-o', 'new', 'next.mat', []};
options = 'error_weight:weight input_weight:weight input_change_weight:weight input_rate_weight:weight';
call = tokid.internal.take('learn', given, options, varargin);
[evidence, run] = tokid.internal.run(call);
next.u = reshape(run.u, size(u));
next.predicted = reshape(run.y, size(y));
next.error = evidence.error;
next.predicted_error = evidence.predicted_error;
end
