"""Arms to look at: in the browser, in figures, in notebooks.

=============  ======================================================================================
`guard`        who may speak to the viewer: this machine, with the token, from the viewer's own page
`server`       viser behind that guard
`control`      one controller at a time
`arm_view`     one arm in the scene, and ghosts of it
`mesh`         the meshes of a description, or what is drawn instead
`surface`      triangles
`view`         the whole window
`panel`        what a tab of the window is
`jog`          the tab with a slider for each joint
`scenery`      the tab with ground, frames, axes and trace
`solve`        what a dragged target means: every solution, and the one taken; `solve_panel` is its tab
`compare`      two models of an arm, and how they differ; `compare_panel`
`paths`        motions to play, and the path of an iteration; `paths_panel`
`plot`         figures as papers print them, saved or shown; each is drawn in a file of its own:
               `path_figure`, `joints_figure`, `error_figure`, `manipulability_figure`,
               `compare_figure`, `map_figure`, all as `figure_look` has it
`notebook`     an arm in a cell of a notebook
=============  ======================================================================================
"""
