"""Where frames come from.

`recognise` tells what a path is; the settings of its kind open a `FrameSequence` (`source`);
`selection` and `other_rig` wrap one. Data sets and kinds of files with several modules have
packages of their own; folders of pairs share `folder_layout`, `pairing` and `names`.
"""
