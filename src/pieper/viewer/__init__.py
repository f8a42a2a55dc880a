"""Arms to look at: in the browser, in figures, in notebooks.

=============  ======================================================================================
`guard`        who may speak to the viewer: this machine, with the token, from the viewer's own page
`server`       viser behind that guard
`arm_view`     one arm in the scene
`mesh`         the meshes of a description, or what is drawn instead
=============  ======================================================================================
"""
