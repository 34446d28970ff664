function paths = without(paths, root, separator)
% A list of folders without those below `root`: MATLAB's own libraries, which other programs must not get.

% SPDX-License-Identifier: BSD-3-Clause

folders = strsplit(paths, separator);
below = strcmp(folders, root) | strncmp(folders, [root, '/'], numel(root) + 1);
paths = strjoin(folders(~below), separator);
end
