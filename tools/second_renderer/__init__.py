"""A second renderer of corridors, to measure detectors on pictures that they were not made with.

Mitsuba (the extra `dev`) traces paths of light through scenes that share nothing with the simulator but
the sizes of the things in them: other walls, other lamps, shadows, sun through windows, glossy floors, glare
on plates, a lens with a depth of field, and fonts that no detector was trained with.

    python -m tools.second_renderer --seed 1 -o FOLDER

writes the pictures as PNG and what is in them as truth.json. tests/vision/corpus was made this way.
"""
