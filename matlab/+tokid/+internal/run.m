function evidence = run(words, folder, files, own, wanted)
% evidence = tokid.internal.run(words, folder, files, own, wanted) runs the tool and gives the evidence that it prints
% as JSON. With own.print, the tool's report appears in the command window instead, and the evidence is []. `wanted`:
% whether the caller wants the evidence. `folder`, `files`: as tokid.internal.call has them. Errors: tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

printed = false;
if isfield(own, 'print')
  printed = own.print;
  if ~(islogical(printed) || isnumeric(printed)) || ~isscalar(printed) || ~(printed == 0 || printed == 1)
    error('tokid:option', '%s: option ''print'': true or false needed', words{1});
  end
end
if ~printed
  evidence = tokid.internal.decode(tokid.internal.call([words, {'--json'}], folder, files), folder);
  return
elseif wanted
  error('tokid:option', ['%s: option ''print'' found beside the result evidence. The tool prints either its report ' ...
                         'or the evidence. Leave one of them out'], words{1});
end
output = tokid.internal.call(words, folder, files);
for i = 1:size(files, 1)
  % A name with blanks may be broken into two lines.
  pattern = strrep(regexptranslate('escape', files{i, 1}), ' ', '\s+');
  output = regexprep(output, pattern, files{i, 2});
end
% The calls of the tool after Next name temporary files. The purpose of such a call goes with it.
purpose = '(;\s+for\s[^:]*|,\s+for\s+example\s[^:]*)?';
output = regexprep(output, ['((^|\n)Next .*?)', purpose, ':\s+tokid .*?(?=\n\S|\s*$)'], '$1');
fprintf('%s', output);
evidence = [];
end
