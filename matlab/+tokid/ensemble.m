function data = ensemble(u, y, varargin)
% TOKID.ENSEMBLE  Repeated experiments as one struct, which every function takes in place of u and y.
%
%   data = tokid.ensemble(u, y)
%   data = tokid.ensemble(u, y, 'dt', 0.01, 'output_names', {'angle', 'rate'}, ...)
%   data = tokid.ensemble(z)     an iddata object, also of several experiments
%
% u is N x T x r and y is N x T x m: N experiments of T steps with r inputs and m outputs. With one input, u is N x T.
% NaN marks a missing sample. Cells {u1, u2, ...} and {y1, y2, ...} of T_i x r and T_i x m hold experiments of unequal
% length, or a single record. Without outputs, y is []. Logs of T x channels x N need u = permute(u, [3 1 2]) and
% y = permute(y, [3 1 2]); a T x N matrix of one channel needs its transpose.
%
%   'dt'              sample time [s] (default that of the model or state beside the data, else 1 and a warning)
%   'length'          N valid samples of each experiment; the rest is ignored
%   'free_y'          Nf x Tf x m outputs of experiments without input from unknown initial states other than zero
%   'initial_state'   'zero' or 'unknown': what is known of the states at step 0 (default: found out by a test)
%   'input_names', 'output_names', 'input_units', 'output_units'   cells of texts
%   'experiment_names'   cell of N different texts, or N numbers: what messages call the experiments (default: their
%                     rows, counted from 0)
%
% The fields of the struct have the names and shapes of the files: see docs/formats.md. Errors: tokid:shape,
% tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'u');
pairs = varargin;
if isa(u, 'iddata')
  data = u;
  if nargin > 1
    pairs = [{y}, pairs];
  end
else
  data.u = u;
  if nargin > 1
    data.y = y;
  end
end
data = tokid.internal.take_data('ensemble', {}, [{data}, pairs], false);
end
