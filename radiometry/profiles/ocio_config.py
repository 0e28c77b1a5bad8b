"""A camera for OpenColorIO: a Common LUT Format file and a configuration that names it.

Common LUT Format (CLF) is version 3 of S-2014-006 of the Academy; the configuration is of version
2. Its scene reference is ACES2065-1.
"""
from __future__ import annotations

from xml.sax.saxutils import escape

import numpy as np

from spectrabox.radiometry.appearance import ACES_WHITE, BRADFORD
from spectrabox.radiometry.profiles.colour_table import ROOT
from spectrabox.radiometry.profiles.icc_profile import PCS_WHITE

# X, Y, Z to ACES2065-1 (AP0), TB-2014-004, under its own white
TO_ACES = np.array([[1.0498110175, 0.0, -0.0000974845], [-0.4959030231, 1.3733130458, 0.0982400361],
                    [0.0, 0.0, 0.9912520182]])


def aces_from_d50() -> np.ndarray:
    """Matrix (3, 3) from X, Y, Z under D50 to ACES2065-1, adapted by Bradford: white is 1, 1, 1."""
    gains = (BRADFORD @ ACES_WHITE) / (BRADFORD @ PCS_WHITE)
    return np.asarray(TO_ACES @ np.linalg.solve(BRADFORD, gains[:, None] * BRADFORD))


def clf_text(name: str, table: np.ndarray) -> str:
    """A CLF file from a camera's signals relative to white to ACES2065-1.

    Parameters
    ----------
    name : str
        Of the transform.
    table : (S, S, S, 3) array
        As of ``colour_table``.
    """
    side = len(table)
    depths = 'inBitDepth="32f" outBitDepth="32f"'

    def exponent(value: float) -> str:
        return (f'  <Exponent {depths} style="basicFwd">\n    <ExponentParams '
                f'exponent="{value:.10g}"/>\n  </Exponent>\n')

    rows = "\n".join(" ".join(f"{value:.6f}" for value in row) for row in table.reshape(-1, 3))
    matrix = "\n".join(" ".join(f"{value:.10f}" for value in row)
                       for row in aces_from_d50() * PCS_WHITE)
    return (f'<?xml version="1.0" encoding="UTF-8"?>\n<ProcessList id="spectrabox" '
            f'compCLFversion="3" name="{escape(name, {chr(34): "&quot;"})}">\n'
            "  <InputDescriptor>camera signals relative to white</InputDescriptor>\n"
            "  <OutputDescriptor>ACES2065-1</OutputDescriptor>\n"
            f"{exponent(1 / ROOT)}"
            f'  <LUT3D {depths} interpolation="tetrahedral">\n'
            f'    <Array dim="{side} {side} {side} 3">\n{rows}\n    </Array>\n  </LUT3D>\n'
            f"{exponent(ROOT)}"
            f'  <Matrix {depths}>\n    <Array dim="3 3">\n{matrix}\n    </Array>\n  </Matrix>\n'
            "</ProcessList>\n")


def ocio_config_text(camera: str, clf_name: str, matrix: np.ndarray) -> str:
    """An OpenColorIO configuration with the camera's signals as two colour spaces: by its table,
    and by its matrix, which goes beyond white too.

    Parameters
    ----------
    camera : str
        Name of the colour space.
    clf_name : str
        Of the file beside the configuration.
    matrix : (3, 3) array
        From signals relative to white to X, Y, Z under D50.
    """
    to_aces = np.eye(4)
    to_aces[:3, :3] = aces_from_d50() @ matrix
    numbers = ", ".join(f"{value:.10f}" for value in to_aces.ravel())
    name, file = _quoted(camera), _quoted(clf_name)
    by_matrix = _quoted(f"{camera} by matrix")
    return f"""ocio_profile_version: 2
search_path: "."
strictparsing: true
roles:
  default: ACES2065-1
  scene_linear: ACES2065-1
  aces_interchange: ACES2065-1
file_rules:
  - !<Rule> {{name: Default, colorspace: ACES2065-1}}
displays:
  sRGB:
    - !<View> {{name: Colorimetric, colorspace: sRGB}}
active_displays: [sRGB]
active_views: [Colorimetric]
colorspaces:
  - !<ColorSpace>
    name: ACES2065-1
    encoding: scene-linear
  - !<ColorSpace>
    name: {name}
    description: signals of the camera relative to white, under the light of its calibration
    encoding: scene-linear
    to_scene_reference: !<FileTransform> {{src: {file}, interpolation: tetrahedral}}
  - !<ColorSpace>
    name: {by_matrix}
    encoding: scene-linear
    to_scene_reference: !<MatrixTransform> {{matrix: [{numbers}]}}
  - !<ColorSpace>
    name: sRGB
    encoding: sdr-video
    from_scene_reference: !<GroupTransform>
      children:
        - !<BuiltinTransform> {{style: UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD}}
        - !<BuiltinTransform> {{style: DISPLAY - CIE-XYZ-D65_to_sRGB}}
"""


def _quoted(words: str) -> str:
    """A YAML string in double quotes."""
    return '"' + words.replace("\\", "\\\\").replace('"', '\\"') + '"'
