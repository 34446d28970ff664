function text = shape(value)
% The size of a value for messages, such as '3 x 4'.

% SPDX-License-Identifier: BSD-3-Clause

text = strjoin(strsplit(num2str(size(value))), ' x ');
end
