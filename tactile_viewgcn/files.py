"""Files that are written whole or not at all, and files to read: which there are, and their md5."""

import errno
import hashlib
import os
import shutil
from collections.abc import Iterator
