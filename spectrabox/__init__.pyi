"""The public names of spectrabox."""
from .api.advise import advise as advise
from .api.camera import CameraEstimate as CameraEstimate
from .api.camera import fit_camera as fit_camera
from .api.chart_check import ChartCheck as ChartCheck
from .api.colour_profile import ColourProfile as ColourProfile
from .api.colour_profile import MatrixComparison as MatrixComparison
from .api.estimates import MeasuredSpectra as MeasuredSpectra
from .api.estimates import SpectrumEstimate as SpectrumEstimate
from .api.estimates import SpectrumEstimates as SpectrumEstimates
from .api.flat import FlatSpectra as FlatSpectra
from .api.flat import flat as flat
from .api.known_camera import KnownCamera as KnownCamera
from .api.known_camera import camera as camera
from .api.meter_reading import MeterReading as MeterReading
from .api.meter_reading import measure_spectrum as measure_spectrum
from .api.photo import ChartInPhoto as ChartInPhoto
from .api.photo import Photo as Photo
from .api.photo import find_chart as find_chart
from .api.photo import open_photo as open_photo
from .api.pictures import uplift as uplift
from .api.scene import SceneSpectra as SceneSpectra
from .api.scene import reconstruct_scene as reconstruct_scene
from .api.session import Session as Session
from .api.signals import match as match
from .api.signals import sample as sample
from .measure.surfaces.colour_comparison import ColourComparison as ColourComparison
from .radiometry.errors import CalibrationError as CalibrationError
from .radiometry.errors import ChartNotFoundError as ChartNotFoundError
from .radiometry.errors import CheckError as CheckError
from .radiometry.errors import ClippedPhotoError as ClippedPhotoError
from .radiometry.errors import ConvergenceError as ConvergenceError
from .radiometry.errors import EnvironmentProblem as EnvironmentProblem
from .radiometry.errors import InputError as InputError
from .radiometry.errors import SpectraboxError as SpectraboxError

__version__: str
