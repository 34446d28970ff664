function text = read_text(file)
% All of a file in UTF-8; nothing where there is none.

% SPDX-License-Identifier: BSD-3-Clause

text = '';
id = fopen(file, 'r');
if id >= 0
  text = native2unicode(fread(id, Inf, 'uint8=>uint8')', 'UTF-8');
  fclose(id);
end
end
