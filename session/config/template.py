"""The session.toml that ``spectrabox new`` writes."""

SESSION_TEMPLATE = '''# A spectrabox session. Every file name is relative to this folder. Lines with # are comments.
# Put photos into photos/, spectra into spectra/, Mitsuba scenes into scene/.
# Then: spectrabox check . and spectrabox run .

[session]
name = "untitled session"
operator = ""
notes = ""
seed = 1                            # same seed, same results

[photos]
object = "photos/object.dng"        # the scene: camera raw, or linear EXR / TIFF
chart = "photos/chart.dng"          # a ColorChecker Classic under the same light, same camera
# flat = "photos/flat.dng"          # evenly lit white card: corrects vignetting
# dark = ["photos/dark.dng"]        # lens covered, same exposures; a list in place of one photo is a bracket

[chart]
reference = "BabelColor Average"    # or "ISO 17321-1", "ColorChecker N Ohta", or a CSV of 24 measured columns
scene = "scene/chart.xml"           # light and chart in their places; the chart is a rectangle with id "chart"
# corners_px = [[x, y], [x, y], [x, y], [x, y]]   # only if it is not found: dark skin, bluish green, black, white

# [camera]
# lens = "lens.json"                # from 'spectrabox geometry lens': object photos are undistorted

# [drift]                           # neutral references seen in both photos: did the light change in between?
# chart_px = [[[x, y], [x, y], [x, y], [x, y]]]
# object_px = [[[x, y], [x, y], [x, y], [x, y]]]

[light]
spectrum = "spectra/light.csv"      # { file = "spectra/light.csv", column = 2 } where the file holds several columns

[sensitivity]
from = "chart"                      # or a file of measured curves: "spectra/camera.csv"
# method = "prior"                  # learnt from measured cameras; or "smooth", "nonnegative", "paper"
# truth = "spectra/camera.csv"      # measured curves to compare with

[scale]
from = "chart"                      # or "material": a material with a known spectrum sets the scale

[scene]
file = "scene/scene.xml"            # geometry, camera pose and light in their places

# [views.warm]                      # a further photo of the same materials under another light, or from elsewhere
# photo = "photos/warm.dng"
# light = "spectra/warm.csv"        # without it: the light above
# chart = "photos/chart_warm.dng"   # without it: materials in common tell its strength

[materials.wall]                    # one table for every BSDF that a surface wears
bsdf = "wall"                       # its id in the scene
# known = "spectra/wall.csv"        # measured, taken as given
# truth = "spectra/wall.csv"        # measured, only compared with

[reconstruct]
engine = "auto"                     # light traced once; by gradient where a material is coated or glossy
coefficients = 11                   # B-spline coefficients of each spectrum
width = 96                          # pixels of the rendered view
steps = 160                         # of the gradient engine, with spp samples per pixel each
spp = 16

[sampling]
method = "prior"                    # learnt from measured reflectances; or "uniform", "paper"
draws = 4000
level = 0.95
'''
