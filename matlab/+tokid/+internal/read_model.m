function model = read_model(folder, file, files)
% The new model out of its temporary file.

% SPDX-License-Identifier: BSD-3-Clause

[~, ~, extension] = fileparts(file);
if ~strcmp(extension, '.mat')
  written = fullfile(folder, 'converted.mat');
  tokid.internal.call({'convert', file, written}, folder, files);
  file = written;
end
model = tokid.internal.read_mat(file);
end
