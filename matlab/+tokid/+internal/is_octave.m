function yes = is_octave()
% SPDX-License-Identifier: BSD-3-Clause
yes = exist('OCTAVE_VERSION', 'builtin') ~= 0;
end
