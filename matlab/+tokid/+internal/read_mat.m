function contents = read_mat(file)
% contents = tokid.internal.read_mat(file) reads a .mat that the tool has written.

% SPDX-License-Identifier: BSD-3-Clause

contents = load(file, '-mat');
end
