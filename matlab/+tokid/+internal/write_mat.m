function write_mat(file, contents)
% tokid.internal.write_mat(file, contents) writes the fields of a struct as the variables of a .mat that the tool reads at
% once; variables beyond 2 GiB need MATLAB. Errors: tokid:tooLarge.

% SPDX-License-Identifier: BSD-3-Clause

bytes = structfun(@(v) 8 * numel(v), contents);
if all(bytes < 2^31)
  save(file, '-struct', 'contents', '-v6');
elseif tokid.internal.is_octave()
  error('tokid:tooLarge', ['an array of %.1f GiB found, Octave can write at most 2 GiB; write an .h5, whose name can ' ...
                           'be given in place of arrays'], max(bytes) / 2^30);
else
  save(file, '-struct', 'contents', '-v7.3');
end
end
