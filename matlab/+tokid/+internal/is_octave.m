function yes = is_octave()
% SPDX-License-Identifier: BSD-3-Clause
persistent answer
if isempty(answer)
  answer = exist('OCTAVE_VERSION', 'builtin') ~= 0;
end
yes = answer;
end
