function [evidence, varargout] = run(call, results)
% [evidence, contents, ...] = tokid.internal.run(call, results) runs the tool for a call of tokid.internal.take. The
% evidence is what the tool prints as JSON. With call.said.print, the tool's report appears in the command window
% instead, and the evidence is []. For each argument of the kind 'new', the contents of this file follow. `results` is
% the number of results of the public function, of which the second is the evidence. Errors: tokid:option.

% SPDX-License-Identifier: BSD-3-Clause

command = call.command;
printed = isfield(call.said, 'print') && tokid.internal.truth(command, 'print', call.said.print);
if printed && results > 1
  error('tokid:option', ['%s: option ''print'' found beside the result evidence. The tool prints either its report ' ...
                         'or the evidence. Leave one of them out'], command);
end
rows = call.given;
for name = fieldnames(call.said)'
  kind = call.known{strcmp(name{1}, call.known(:, 1)), 2};
  rows(end + 1, :) = {['--', strrep(name{1}, '_', '-')], kind, name{1}, call.said.(name{1})}; %#ok<AGROW>
end
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
words = {regexprep(command, '^(read|write)$', 'convert')};
new = {};
for i = 1:size(rows, 1)
  words = [words, tokid.internal.words(call, folder, rows{i, :})]; %#ok<AGROW>
  if strcmp(rows{i, 2}, 'new')
    new{end + 1} = words{end}; %#ok<AGROW>
  end
end
evidence = [];
if printed
  show(tokid.internal.without_paths(tokid.internal.call(words, folder), folder));
elseif any(strcmp(command, {'read', 'write', 'example', 'predict', 'simulate'}))
  tokid.internal.call(words, folder);
else
  evidence = tokid.internal.decode(tokid.internal.call([words, {'--json'}], folder), folder);
end
varargout = cellfun(@contents_of, new, 'UniformOutput', false);
end

function show(output)
% The calls of the tool after Next name temporary files. The purpose of such a call goes with it.
purpose = '(;\s+for\s[^:]*|,\s+for\s+example\s[^:]*)?';
fprintf('%s', regexprep(output, ['((^|\n)Next .*?)', purpose, ':\s+tokid .*?(?=\n\S|\s*$)'], '$1'));
end

function contents = contents_of(file)
if strcmp(file(end - 2:end), '.h5')
  contents = tokid.read(file);
else
  contents = load(file, '-mat');
end
if isfield(contents, 'experiments')
  contents = rmfield(contents, 'experiments');
end
end
