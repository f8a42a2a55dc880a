"""Coloured markers in a video or camera: where the robots are, in metres, and how sure that is.

``source -> frame -> segment -> pattern -> track -> output``, with colour models and calibration read from YAML.

===============  ====================================================================================
`source`         frames of a video, a folder, a camera, a stream, a pipe or a list, read ahead
`reader`         what each of these is
`frame`          one image with its number and its capture time
`camera`         a camera as numbers: matrix, distortion, size
`field_view`     where on the field a pixel looks: metres from pixels, or pixels as they are
`board`          boards to calibrate a lens with: to print, and to find in an image
`calibration`    a lens from pictures of a board
`hand_eye`       where a camera is on a robot: on its hand or in its cell, from poses and a board
`capture_plan`   from where to look for that
`upright`        where an upright cylinder of known size stands, from its outline in one image
`field`          where the field lies, from corners, field lines or AprilTags
`field_lines`    the lines of fields, and where they are in an image
`color_table`    which colour a pixel is, as a table over all pixels
`segment`        from a frame to patches of colour, in one compiled pass
`masks`          masks of colours, for people who want to look
`blobs`          connected patches of one colour in one frame
`sighting`       what one frame says of one object
`pattern`        layouts of markers, and the robots and balls that the patches of a frame make
`track`          a Kalman filter for each object, one assignment for all, lives and names
`pipeline`       a frame through all of these, each stage timed
`estimate`       what the tracker believes of one object
`overlay`        what was seen and is believed, drawn over the frame
`output`         tables of tracks (CSV, JSON lines, Parquet) and annotated videos
`stream`         steps for whoever listens while it runs
`follow`         a source through a tracker into all of these; can be stopped and resumed
===============  ====================================================================================
"""
