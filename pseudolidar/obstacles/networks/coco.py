"""Class names of COCO, which most published detectors were trained on.

Source: Lin et al., Microsoft COCO, 2014; the 80 classes of its detection task, 2017.
"""

from __future__ import annotations

_NAMES = """person, bicycle, car, motorcycle, airplane, bus, train, truck, boat, traffic light,
fire hydrant, stop sign, parking meter, bench, bird, cat, dog, horse, sheep, cow, elephant, bear,
zebra, giraffe, backpack, umbrella, handbag, tie, suitcase, frisbee, skis, snowboard, sports ball,
kite, baseball bat, baseball glove, skateboard, surfboard, tennis racket, bottle, wine glass, cup,
fork, knife, spoon, bowl, banana, apple, sandwich, orange, broccoli, carrot, hot dog, pizza, donut,
cake, chair, couch, potted plant, bed, dining table, toilet, tv, laptop, mouse, remote, keyboard,
cell phone, microwave, oven, toaster, sink, refrigerator, book, clock, vase, scissors, teddy bear,
hair drier, toothbrush"""
COCO_NAMES = tuple(_NAMES.replace("\n", " ").split(", "))
# Numbers of 1-90 that no class of the detection task has.
_UNUSED = (12, 26, 29, 30, 45, 66, 68, 69, 71, 83)
MOST_COCO_LABELS = 91
# By the numbers of its annotation files, from 1, which TensorFlow and torchvision keep.
COCO_BY_NUMBER = dict(zip([n for n in range(1, 91) if n not in _UNUSED], COCO_NAMES, strict=True))
