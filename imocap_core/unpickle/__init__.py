"""Pickles read without running anything that is in them: arrays, tensors and Python's containers.

A pickle may name any function, `os.system` included. Here a pickle's arrays become plain records,
which are turned into numpy arrays when what they state has been checked; every other name is
refused. The rooms that read files (`body`, `io`) put their own sentence around the errors.
"""

from imocap_core.unpickle.reader import UNREADABLE, load_pickle
from imocap_core.unpickle.records import InertObject, build

__all__ = ["UNREADABLE", "InertObject", "build", "load_pickle"]
