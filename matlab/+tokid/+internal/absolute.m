function file = absolute(file)
% The name of a file that stays good when the current folder changes.

% SPDX-License-Identifier: BSD-3-Clause

if ispc()
  known = ~isempty(regexp(file, '^([A-Za-z]:[\\/]|[\\/])', 'once'));
else
  known = strncmp(file, '/', 1);
end
if ~known
  file = fullfile(pwd(), regexprep(file, '^(\./+)+', ''));
end
end
