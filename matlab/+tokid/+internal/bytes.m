function text = bytes(text)
% The text with a character for each byte of its UTF-8, as files and command lines hold it; in Octave texts are so.

% SPDX-License-Identifier: BSD-3-Clause

if ~tokid.internal.is_octave() && ~ispc()
  text = char(unicode2native(text, 'UTF-8'));
end
end
