# SPDX-License-Identifier: BSD-3-Clause
"""Tables of other programs → ensembles. `read.py` names the steps; each other file is one of them."""

from .read import read as read
from .recording import OPTIONS as OPTIONS
from .sources import is_several as is_several
