function evidence = report(page, model, varargin)
% TOKID.REPORT  A page (HTML) that shows whether a model can be trusted.
%
%   tokid.report('page.html', model, u, y)
%   evidence = tokid.report('page.html', model, data, 'horizon', 10)
%   tokid.report('page.html', 'model.npz', 'fresh.npz', 'compare', {'first.npz', 'second.npz'})
%
% The page is one file that loads nothing; docs/tutorial.md shows what is on it. The evidence is what
% 'tokid report --json' prints: trust, summary, reasons, checks and more (docs/formats.md). What can be said of data:
% see tokid.ensemble. Options:
%   'horizon'             steps ahead of the multi-step fit (default 10)
%   'experiments'         experiments in the plots, at most (default 24)
%   'at'                  steps of the responses (default steps at even distances): [0 20 50]
%   'bands'               file of the experiments of the identification, for 95 % bands of the responses
%   'compare'             another model, or a cell of several, to compare on the page: structs or names of files
%   'inputs', 'outputs'   columns of a .csv
%
% Warnings have the identifier tokid:report; errors as in tokid.identify, and tokid:model.

% SPDX-License-Identifier: BSD-3-Clause

tokid.internal.need(nargin, 'page', 'model');
known = {'horizon', 'value'; 'experiments', 'value'; 'at', 'list'; 'bands', 'file'; 'compare', 'own'; ...
         'inputs', 'list'; 'outputs', 'list'};
[folder, clean] = tokid.internal.folder(); %#ok<ASGLU>
[file, of_model] = tokid.internal.take_model(folder, model);
[data, pairs, files] = tokid.internal.take_data(folder, true, varargin, model, {});
[words, own] = tokid.internal.options('report', known, pairs, tokid.internal.data_fields());
others = {};
if isfield(own, 'compare')
  others = own.compare;
end
if isa(others, 'string')
  others = cellstr(others);
elseif ~iscell(others)
  others = {others};
end
for i = 1:numel(others)
  [other, of_other] = tokid.internal.take_model(folder, others{i}, sprintf('other_%d', i));
  words = [words, {'--compare', other}]; %#ok<AGROW>
  files = [files; of_other]; %#ok<AGROW>
end
words = [{'report', file, data, '-o', tokid.internal.file_name(page), '--json'}, words];
output = tokid.internal.call(words, folder, [of_model; files]);
if nargout > 0
  evidence = tokid.internal.decode(output, folder);
end
end
