function sys = to_ss(model, k)
% TOKID.TO_SS  One step of a model as a state-space object of the control package (Octave) or toolbox (MATLAB).
%
%   sys = tokid.to_ss(model, k)   the matrices of step k, where 0 is the step of the first sample
%   sys = tokid.to_ss(model)      of a time-invariant model
%
% A discrete-time ss with the model's sample time, channel names and, in MATLAB, units. In Octave, 'pkg load control'
% comes first. A mean motion that was removed is not in it. Errors: tokid:step (no such step, or a step at which the
% number of states changes; without k, a model that varies), tokid:model, tokid:noControl.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'model');
if ischar(model) || isa(model, 'string')
  model = tokid.read(model);
end
model = tokid.internal.check_model(model, {'A', 'B', 'C', 'D', 'state_dim'});
if isempty(which('ss'))
  error('tokid:noControl', ['the function ss was not found: ''pkg load control'' in Octave, ' ...
                            'a toolbox in MATLAB']);
end
[S, period, first] = deal(size(model.A, 3), model.period, model.k_begin);
if nargin > 1
  if ~isnumeric(k) || ~isreal(k)
    error('tokid:step', 'a step of class %s found, a whole number needed', class(k));
  end
  s = tokid.internal.place(double(k) - first + 1, S, period);
  if ~isscalar(k) || k ~= fix(k) || s < 1 || s > S
    error('tokid:step', 'step %s found, the model has the steps %d to %d', mat2str(k), first, ...
          first + S - 1);
  end
elseif period == 1 % the last step has all states
  full = model.state_dim == max(model.state_dim);
  s = find(full(1:S) & full(2:S + 1), 1);
elseif S == 1
  s = 1;
else
  error('tokid:step', 'the model varies in time: say the step, tokid.to_ss(model, k)');
end
n = model.state_dim(s);
if model.state_dim(s + 1) ~= n
  error('tokid:step', 'step %d leads from %d to %d states, which no ss can hold', ...
        first + s - 1, n, model.state_dim(s + 1));
end
sys = ss(model.A(1:n, 1:n, s), model.B(1:n, :, s), model.C(:, 1:n, s), model.D(:, :, s), model.dt);
properties = {'InputName', 'input_names'; 'OutputName', 'output_names'; ...
              'InputUnit', 'input_units'; 'OutputUnit', 'output_units'};
for i = 1:4 - 2 * tokid.internal.is_octave() % Octave has no units
  texts = cellstr(model.(properties{i, 2}));
  if ~isempty(texts)
    sys = set(sys, properties{i, 1}, texts);
  end
end
end
