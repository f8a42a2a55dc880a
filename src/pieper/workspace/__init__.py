"""Where an arm can reach, how well, and where to place it: maps over voxels, made in chunks and kept in a file.

========================= ==============================================================
looking for               open
========================= ==============================================================
what is asked of an arm   `pieper.workspace.survey`
voxels and chunks         `pieper.workspace.grid`
evenly spread rotations   `pieper.workspace.orientations`
what is counted           `pieper.workspace.measure`
the computation           `pieper.workspace.run`
the result                `pieper.workspace.map`
the file                  `pieper.workspace.store`
surfaces                  `pieper.workspace.boundary`
CSV, HDF5, PLY, VTK       `pieper.workspace.export`
where to put the base     `pieper.workspace.place`
========================= ==============================================================
"""
