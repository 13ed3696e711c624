"""Published pairs as data sets: KITTI, nuScenes, OpenCalib, any folder. One file a format."""

from __future__ import annotations

from lcdata.dataset.importers.folder import Folder
from lcdata.dataset.importers.kitti_odometry import KittiOdometry
from lcdata.dataset.importers.kitti_raw import KittiRaw
from lcdata.dataset.importers.nuscenes import NuScenes
from lcdata.dataset.importers.opencalib import OpenCalib
from lcdata.dataset.importers.published import Choice, Importer, Item, Lost, Published
from lcdata.dataset.importers.write import import_dataset

__all__ = [
    "Choice",
    "Folder",
    "Importer",
    "Item",
    "KittiOdometry",
    "KittiRaw",
    "Lost",
    "NuScenes",
    "OpenCalib",
    "Published",
    "import_dataset",
]
