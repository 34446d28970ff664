function file = file_name(file)
% The name of a file as the tool takes it: without '~', and never taken for an option. Errors: tokid:input.

% SPDX-License-Identifier: BSD-3-Clause

if isa(file, 'string') && isscalar(file)
  file = char(file);
end
if ~ischar(file) || size(file, 1) ~= 1
  error('tokid:input', 'the name of a file needed, %s of class %s found', ...
        strjoin(arrayfun(@(n) sprintf('%d', n), size(file), 'UniformOutput', false), ' x '), class(file));
end
if ~ispc() && (strcmp(file, '~') || strncmp(file, '~/', 2))
  file = [getenv('HOME'), file(2:end)];
elseif strncmp(file, '-', 1)
  file = ['./', file];
end
end
