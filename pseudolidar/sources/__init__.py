"""Where frames come from.

`recognise` tells what a path is; settings of a kind (`KittiRaw`, `KittiObject`, `KittiStereo`,
`KittiOdometry`, `Folders`, `Synthetic`) open a `FrameSource` (`source`); `selection` and
`other_rig` wrap one. KITTI's layouts share `kitti_parts` and `kitti_frames`, folders of pairs
`folder_layout`, `pairing` and `names`; the rendered worlds are in `worlds`.
"""
