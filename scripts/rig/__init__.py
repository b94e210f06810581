"""The rig and its cameras: geometry, plates and words, without files, Blender and images' contents."""

import os

import cv2


def _without_ipp():
    """Have OpenCV do without Intel's IPP, in all threads: equal numbers on all processors.

    IPP asks the processor for its kind at every call, which takes a virtual machine twenty times as long as
    a small call itself; cv2.ipp.setUseIPP would speak for one thread only.
    """
    os.environ.setdefault("OPENCV_IPP", "disabled")
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
    cv2.ipp.useIPP()  # reads the environment, and would warn that it is disabled
    cv2.utils.logging.setLogLevel(level)


_without_ipp()
