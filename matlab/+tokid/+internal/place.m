function s = place(s, S, period)
% The places of steps among S steps of a periodic model, which goes on after its last step. Places beyond S stay as
% they are if the model is not periodic, or not known for a whole period.

% SPDX-License-Identifier: BSD-3-Clause

later = s > S & period > 0 & S >= period;
s(later) = S - period + 1 + mod(s(later) - S - 1, period);
end
