function text = without_paths(text, folder)
% The text with the names of temporary files in place of their paths, which may be broken into lines at blanks.

% SPDX-License-Identifier: BSD-3-Clause

path = strrep(regexptranslate('escape', [folder, filesep()]), ' ', '\s+');
text = regexprep(text, [path, '(?:models.)?([^/\\]*?)\.(?:mat|h5)'], '$1');
end
