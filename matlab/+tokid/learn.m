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
known = {'error_weight', 'list'; 'input_weight', 'list'; 'input_change_weight', 'list'; 'input_rate_weight', 'list'};
words = tokid.internal.options('learn', known, varargin);
if ~isequal(size(reference), size(y)) || size(u, 1) ~= size(y, 1) || ndims(u) > 2 || ndims(y) > 2
  error('tokid:shape', 'learn: reference %s, u %s and y %s found, T x m, T x r and T x m needed', ...
        mat2str(size(reference)), mat2str(size(u)), mat2str(size(y)));
end
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[file, of_model] = tokid.internal.take_model(folder, model);
last = fullfile(folder, 'last.mat');
wanted = fullfile(folder, 'wanted.mat');
tokid.internal.write_ensemble(last, one_run(u, y));
tokid.internal.write_ensemble(wanted, one_run(u, reference));
written = fullfile(folder, 'next.mat');
files = [of_model; {last, 'the last run'; wanted, 'the reference'}];
output = tokid.internal.call([{'learn', file, last, wanted, '-o', written, '--json'}, words], folder, files);
evidence = tokid.internal.decode(output, folder);
run = tokid.internal.read_mat(written);
next = struct('u', reshape(run.u, size(u)), 'predicted', reshape(run.y, size(y)), 'error', evidence.error, ...
              'predicted_error', evidence.predicted_error);
end

function data = one_run(u, y)
data = tokid.ensemble(reshape(u, [1, size(u)]), reshape(y, [1, size(y)]));
end
