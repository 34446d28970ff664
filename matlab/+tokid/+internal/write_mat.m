function write_mat(file, contents)
% tokid.internal.write_mat(file, contents) writes the fields of a struct as the variables of a .mat, not compressed
% where that is possible. Errors: tokid:tooLarge where it would take version 7.3, which Octave can't write.

% SPDX-License-Identifier: BSD-3-Clause

bytes = structfun(@(v) 8 * numel(v), contents);
format = '-v6';
if any(bytes >= 2^31)
  format = '-v7.3';
  if tokid.internal.is_octave()
    error('tokid:tooLarge', ['an array of %.1f GiB found, Octave can write at most 2 GiB; the name of an .h5 can ' ...
                             'be given in place of arrays'], max(bytes) / 2^30);
  end
elseif ~tokid.internal.is_octave() && any(structfun(@beyond_ascii, contents))
  format = '-v7'; % -v6 of MATLAB knows no Unicode
end
save(file, '-struct', 'contents', format);
end

function yes = beyond_ascii(value)
if iscell(value)
  value = strjoin(value(:)', '');
end
yes = ischar(value) && any(value(:) > 127);
end
