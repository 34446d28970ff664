function file = file_name(file)
% The name of a file as the tool takes it: without '~', and never taken for an option.

% SPDX-License-Identifier: BSD-3-Clause

file = char(file);
if ~ispc() && (strcmp(file, '~') || strncmp(file, '~/', 2))
  file = [getenv('HOME'), file(2:end)];
elseif strncmp(file, '-', 1)
  file = ['./', file];
end
end
