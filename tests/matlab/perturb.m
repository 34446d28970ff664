function perturb(seed)
% Perturbs the outputs of all ensembles of the caller, as tests/perturbation.py does. A bit of each number decides about
% its sign, so that the random numbers of the caller stay as they are.

% SPDX-License-Identifier: BSD-3-Clause

names = evalin('caller', 'who');
for i = 1:numel(names)
  value = evalin('caller', names{i});
  if isstruct(value) && isscalar(value) && all(isfield(value, {'u', 'y', 'dt'})) && isa(value.y, 'double')
    y = value.y;
    up = mod(floor(abs(y) ./ eps(y) / 2 ^ seed), 2);
    all_digits = isfinite(y) & y * 1e9 ~= round(y * 1e9);
    y(all_digits) = y(all_digits) .* (1 + 3e-16 * (2 * up(all_digits) - 1));
    value.y = y;
    assignin('caller', names{i}, value);
  end
end
end
