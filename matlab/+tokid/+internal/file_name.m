function file = file_name(file)
% The name of a file as the tool takes it: without '~', and never taken for an option. Errors: tokid:input.

% SPDX-License-Identifier: BSD-3-Clause

if ~tokid.internal.is_text(file)
  error('tokid:input', 'the name of a file needed, %s of class %s found', tokid.internal.shape(file), class(file));
end
file = char(file);
if ~ispc() && (strcmp(file, '~') || strncmp(file, '~/', 2))
  file = [getenv('HOME'), file(2:end)];
elseif strncmp(file, '-', 1)
  file = ['./', file];
end
end
