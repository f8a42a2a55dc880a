"""Coloured markers in a video or camera: where the robots are, in metres, and how sure that is.

``source -> frame -> segment -> pattern -> track -> output``, with colour models and calibration read from YAML.

================  ====================================================================================
`source`          frames of a video, a folder, a camera, a stream, a pipe or a list, read ahead
`reader`          a video, a folder, a list; `live_reader` a camera or stream, `pipe_reader` a pipe
`frame`           one image with its number and its capture time
`camera`          a camera as numbers: matrix, distortion, size
`field_view`      where on the field a pixel looks: metres from pixels, or pixels as they are
`board`           boards to calibrate a lens with: to print, and to find in an image
`board_views`     views of a board that are sharp and differ, from images and videos
`image_file`      one image: a picture, or a frame of a video
`calibration`     a lens from pictures of a board
`hand_eye`        where a camera is on a robot: on its hand or in its cell, from poses and a board
                  its parts are `hand_eye_poses`, `_forms`, `_agreement`, `_refinement` and `_doubts`
`capture_plan`    from where to look for that
`upright`         where an upright cylinder of known size stands, from its outline in one image
`field`           where the field lies, from corners, field lines or AprilTags
                  with `field_lens`, the unknowns, `field_search`, lines looked for, and `tags`
`field_lines`     the lines of fields, and where they are in an image
`color`           what a colour is: a distribution of pixels; `color_learning`, `color_regions`, `adapt`
`drawn_color`     in which colours things are drawn
`color_table`     which colour a pixel is, as a table over all pixels
`segment`         from a frame to patches of colour, in one compiled pass
`masks`           masks of colours, for people who want to look
`blobs`           connected patches of one colour in one frame
`sighting`        what one frame says of one object
`pattern`         layouts of markers
`pattern_finder`  the robots and balls that the patches of a frame make; `lone_marker` for single ones
`track`           a Kalman filter for each object, one assignment for all, lives and names
`pipeline`        a frame through all of these, each stage timed
`estimate`        what the tracker believes of one object
`overlay`         what was seen and is believed, drawn over the frame
`output`          tables of tracks (CSV, JSON lines, Parquet); `video_file` annotated videos
`scene`           things that move over a field, to be rendered; `scene_presets` some of them
`stream`          steps for whoever listens while it runs
`follow`          a source through a tracker into all of these; can be stopped and resumed
================  ====================================================================================
"""
