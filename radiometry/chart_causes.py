"""Which cause explains what is wrong with a chart photo: causes compete, and rivals are named.

Several causes leave much the same on the patches: glare, a tone curve and a black level lift dark
patches, uneven light and a shadow darken one side. Each cause is a small model of the signals,

    signal(i, k) = cause(exp(field(i)) sum_b expected(i, b) mixing(b, k)) + glare(k),

with a field, a mixing of the bands and a little glare that every photo has, and parameters of its
own with a normal prior. Signals err by parts of their own in every band and by parts that a patch's
bands share, of sizes that are not known. The evidence is the integral over all of these: the model
is linearised about its most probable parameters (Laplace's approximation) [Bishop 2006, Sec. 4.4],
and the sizes of the errors are summed over. A model with more freedom pays for it by its prior. A
cause is named when it beats every other by ``MARGIN`` nats; the others within it are named beside
it.
"""
from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from scipy.special import logsumexp

from spectrabox.radiometry.findings import Finding, Severity, worst

VEIL, REFLECTION, UNEVEN, TWO_LIGHTS = "veil", "reflection", "uneven-light", "two-lights"
TONE, COMPUTED, BLACK, SHADING = "tone-curve", "computed-colours", "black-level", "colour-shading"
SHADOW, LIGHT, CHART = "shadow-edge", "stated-light", "chart-itself"
CHANCE = "chance"       # an ordinary photo
CAUSES = (VEIL, REFLECTION, UNEVEN, TWO_LIGHTS, TONE, COMPUTED, BLACK, SHADING, SHADOW, LIGHT,
          CHART)

# the causes that a finding names
CLAIMS: dict[str, tuple[str, ...]] = {
    "chart.veiled": (VEIL,), "chart.glare": (REFLECTION,), "chart.uneven-light": (UNEVEN,),
    "calibration.veil": (VEIL,), "light.two-kinds": (TWO_LIGHTS,), "light.contradicted": (LIGHT,),
    "patches.glare": (REFLECTION,), "patches.unlike-reference": (CHART, REFLECTION),
    "patches.unlike-reference-or-light": (CHART, REFLECTION, LIGHT)}

MARGIN = 3.0            # nats by which a cause that is named beats its rivals
MOST_NAMED = 3          # causes that are named together

# beforehand, standard deviations: of the log gain of a band, of what a band holds of another, of
# each term of the log light over the chart (linear and quadratic, a term spans the chart), and of
# the glare that every lens has, in shares of white
GAIN_SD, FIELD_SD, GLARE_SD = 0.5, 0.06, 0.005
# what a matrix from a camera's bands to Rec.709 takes of each band's neighbour, its standard
# deviation, and that of what it takes of the other band
MATRIX = (-0.4, 0.3, 0.15)
OWN_ERRORS = (0.004, 0.008, 0.016, 0.032, 0.064)        # relative, of each band of a patch
COMMON_ERRORS = (0.004, 0.012, 0.03)                    # relative, of all bands of a patch
FIRST_OWN, FIRST_COMMON = 0.016, 0.012                  # about which models are linearised
OWN_DARK, COMMON_DARK = 0.1, 0.03       # of the brightest patch: below it errors are no longer so
RARE_PATCH = -5.0       # log odds that a patch is soiled, or mirrors something
MOST_PATCHES = 6        # of which that is supposed
CANDIDATES = 6          # lines of a shadow and places of a reflection that are looked at closely
PENUMBRA = 0.25         # of the distance of two patches
STEPS, SMALL = 8, 1e-4  # of Gauss and Newton; of a derivative


Change = Callable[[np.ndarray, np.ndarray], np.ndarray]   # (signals, parameters) -> signals


def ranked(signal: np.ndarray, expected: np.ndarray, error: np.ndarray, positions: np.ndarray,
           mixing_sd: float, known: Mapping[str, float] | None = None) -> dict[str, float]:
    """How well each cause explains the signals of a chart: its log evidence in nats above that of
    an ordinary photo, the likeliest first.

    Parameters
    ----------
    signal : (I, K) array
        Of the patches.
    expected : (I, K) array
        Of an ordinary photo, of any scale in each band; all patches under one light.
    error : (I, K) array
        Of the mean signal, by the pixels' noise.
    positions : (I, 2) array
        On the chart, any unit.
    mixing_sd : float
        Of a band's share of another, by the camera.
    known : mapping, optional
        Further nats for a cause by evidence of another kind.
    """
    usable = np.isfinite(signal).all(axis=1) & (expected > 0).all(axis=1)
    chart = _Chart(signal[usable], expected[usable], error[usable], positions[usable], mixing_sd)
    ordinary = chart.evidence(_unchanged, np.zeros(0))
    evidence = {cause: float(logsumexp(forms)) - ordinary
                for cause, forms in _evidence(chart).items()}
    for cause, nats in (known or {}).items():
        evidence[cause] = max(evidence.get(cause, 0.0), 0.0) + nats
    evidence[CHANCE] = 0.0
    return dict(sorted(evidence.items(), key=lambda one: -one[1]))


def likely_causes(evidence: Mapping[str, float]) -> tuple[str, ...]:
    """The likeliest cause, and with it those that the data do not exclude.

    Parameters
    ----------
    evidence : mapping
        From `ranked`.
    """
    best = max(evidence.values())
    return tuple(cause for cause, nats in evidence.items() if nats > best - MARGIN)[:MOST_NAMED]


def claims(findings: Iterable[Finding]) -> bool:
    """Whether any finding names a cause of something that is not as it should be.

    Parameters
    ----------
    findings : iterable of Finding
    """
    return any(one.code in CLAIMS and one.severity is not Severity.INFO for one in findings)


def settled(findings: Iterable[Finding], evidence: Mapping[str, float],
            code: str) -> list[Finding]:
    """Findings of a chart photo, of which those that name a cause stay where its rivals are
    excluded; in place of the others comes one with the causes that are not, unless those that stay
    name them already.

    Parameters
    ----------
    findings : iterable of Finding
    evidence : mapping
        From `ranked`, of the photo that they are about.
    code : str
        Of the finding that takes their place: its values have ``causes``, the likeliest first, and
        ``doubts``, the values of each finding that it replaces by its code.
    """
    named = likely_causes(evidence)
    kept: list[Finding] = []
    doubts: list[Finding] = []
    for one in findings:
        causes = CLAIMS.get(one.code, ())
        # that a light is contradicted says itself what else may be
        right = set(named) <= set(causes) or (causes == (LIGHT,) and LIGHT in named)
        (doubts if claims([one]) and not right else kept).append(one)
    said = {cause for one in kept if claims([one]) for cause in CLAIMS[one.code]}
    if not doubts or set(named) <= said:
        return kept
    left = [*CLAIMS[doubts[0].code], CHANCE] if named == (CHANCE,) else list(named)
    return [*kept, Finding(code, worst(doubts), doubts[0].subject, {
        "causes": left, "doubts": {one.code: dict(one.values) for one in doubts}})]


# ---- the causes ----------------------------------------------------------------------------------

def _unchanged(signal: np.ndarray, _: np.ndarray) -> np.ndarray:
    return signal


def _evidence(chart: _Chart) -> dict[str, list[float]]:
    """Log evidence of each form that a cause can take, with that of the form beforehand."""
    bands, field = chart.bands, chart.field
    plane, contrasts = field[:, :2], chart.contrasts
    drifts = np.einsum("ia,kc->ikac", plane, contrasts).reshape(*chart.shape, -1)
    # of a lens: by the square of the distance from the middle of a photo in which the chart lies
    # anywhere
    square = np.sum(chart.plane**2, axis=1)
    lens = np.column_stack([(square - square.mean()) / square.std(), plane])
    curved = np.einsum("ia,kc->ikac", lens, contrasts).reshape(*chart.shape, -1)
    curved_sd = np.repeat([0.03, 0.05, 0.05], contrasts.shape[1])

    def even(signal: np.ndarray, by: np.ndarray) -> np.ndarray:
        return signal + by[0] ** 2 * (1 + by[1:])

    def curve(signal: np.ndarray, by: np.ndarray) -> np.ndarray:
        return np.sign(signal) * np.maximum(np.abs(signal), 1e-4) ** np.exp(by[0])

    return {
        # some veils are coloured by what they come from
        VEIL: [chart.evidence(even, np.r_[0.15, np.full(bands, 0.15)],
                              np.r_[0.25, np.zeros(bands)])],
        UNEVEN: [chart.evidence(_unchanged, np.zeros(0), field_sd=0.25)],
        TWO_LIGHTS: [chart.evidence(lambda signal, by: signal * np.exp(drifts @ by),
                                    np.full(drifts.shape[2], 0.1), field_sd=0.1)],
        SHADING: [chart.evidence(lambda signal, by: signal * np.exp(curved @ by), curved_sd,
                                 field_sd=0.1)],
        TONE: [chart.evidence(curve, np.array([0.15]), np.array([np.log(power)]), np.log(1 / 3))
               for power in (0.45, 0.6, 0.8)],
        COMPUTED: [chart.evidence(_unchanged, np.zeros(0), matrix=True)],
        LIGHT: [chart.evidence(_unchanged, np.zeros(0), mixing=0.25)],
        BLACK: _black_levels(chart),
        SHADOW: _shadows(chart), REFLECTION: _reflections(chart), CHART: _soiled(chart)}


def _black_levels(chart: _Chart) -> list[float]:
    """One level in all bands, in shares of the brightest, or one of each band."""
    share = chart.white.max() / chart.white
    return [chart.evidence(lambda signal, by: signal + by[0] * share * (1 + by[1:]),
                           np.r_[0.06, np.full(chart.bands, 0.05)], log_prior=np.log(0.7)),
            chart.evidence(lambda signal, by: signal + by * share, np.full(chart.bands, 0.05),
                           log_prior=np.log(0.3))]


def _shadows(chart: _Chart) -> list[float]:
    """Patches at one side of a line, the likeliest lines alone."""
    sides = []
    for angle in np.arange(8) * np.pi / 8:
        along = chart.plane @ np.array([np.cos(angle), np.sin(angle)])
        levels = np.unique(np.round(along, 6))
        # between rows, and through them with a soft edge
        sides += [along > cut for cut in (levels[1:] + levels[:-1]) / 2]
        sides += [1 / (1 + np.exp((cut - along) / (PENUMBRA * chart.pitch))) for cut in levels]
    masks = np.unique(np.round(np.array(sides, float), 3), axis=0)
    within = masks.sum(axis=1)
    masks = masks[(within > 1) & (within < len(chart.plane) - 1)]
    best = chart.likeliest(np.repeat(masks[:, :, None], chart.bands, axis=2) * chart.start, 0.3)

    def darkened(mask: np.ndarray) -> float:
        # what lights the shadow is a little of another colour
        return chart.evidence(
            lambda signal, by: signal * np.exp(mask[:, None] * (by[0] + by[1:])),
            np.r_[0.35, np.full(chart.bands, 0.03)], log_prior=-np.log(len(masks)))
    return [darkened(masks[one]) for one in best]


def _reflections(chart: _Chart) -> list[float]:
    """A round spot anywhere on the chart, or some patches that mirror something."""
    spots = np.array([np.exp(-0.5 * np.sum((chart.plane - centre) ** 2, axis=1)
                             / (width * chart.pitch) ** 2)
                      for centre in chart.plane for width in (0.7, 1.2, 2.0)])
    best = chart.likeliest(np.repeat(spots[:, :, None], chart.bands, axis=2), 0.15)

    def bright(spot: np.ndarray) -> float:
        return chart.evidence(
            lambda signal, by: signal + spot[:, None] * by[0] ** 2 * (1 + by[1:]),
            np.r_[0.2, np.full(chart.bands, 0.1)], np.r_[0.3, np.zeros(chart.bands)],
            -np.log(len(spots)) + np.log(0.5))

    def mirrors(some: list[int]) -> float:
        where = np.eye(chart.shape[0])[:, some]
        return chart.evidence(lambda signal, by: signal + (where @ by**2)[:, None],
                              np.full(len(some), 0.2), np.full(len(some), 0.25),
                              RARE_PATCH * len(some) + np.log(0.5))
    lifts = np.repeat(np.eye(chart.shape[0])[:, :, None], chart.bands, axis=2)
    return [*(bright(spots[one]) for one in best),
            *map(mirrors, chart.one_by_one(lifts, 0.1, positive=True))]


def _soiled(chart: _Chart) -> list[float]:
    """Some patches that are not as the chart's reference says, in level and colour."""
    patches = chart.shape[0]

    def departing(some: list[int]) -> float:
        where = np.eye(patches)[:, some]
        return chart.evidence(lambda signal, by: signal * np.exp(
            where @ (by.reshape(len(some), -1)[:, :1] + by.reshape(len(some), -1)[:, 1:])),
            np.tile(np.r_[0.2, np.full(chart.bands, 0.1)], len(some)),
            log_prior=RARE_PATCH * len(some))
    changes = np.repeat(np.eye(patches)[:, :, None], chart.bands, axis=2) * chart.start
    return [departing(some) for some in chart.one_by_one(changes, 0.2)]


# ---- evidence ------------------------------------------------------------------------------------

class _Chart:
    """Signals with white at 1, what is expected of them, and the evidence of a model of both.

    Parameters are those of ``ranked``, of the patches that can be read.
    """

    def __init__(self, signal: np.ndarray, expected: np.ndarray, error: np.ndarray,
                 positions: np.ndarray, mixing_sd: float) -> None:
        lightest = int(expected.sum(axis=1).argmax())
        self.white = np.maximum(signal[lightest], 1e-3 * signal.max())
        self.signal = signal / self.white
        self.expected = expected / expected[lightest]
        self.noise = (error / self.white) ** 2
        self.mixing_sd = mixing_sd
        self.shape, self.bands = signal.shape, signal.shape[1]
        self.plane = (positions - positions.mean(axis=0)) / positions.std(axis=0).max()
        apart = np.linalg.norm(self.plane[:, None] - self.plane, axis=2)
        self.pitch = float(np.median(np.sort(apart, axis=1)[:, 1]))
        x, y = (self.plane / self.plane.std(axis=0)).T
        terms = np.column_stack([x, y, x**2, y**2, x * y])
        self.field = (terms - terms.mean(axis=0)) / terms.std(axis=0)
        self.contrasts = np.linalg.svd(np.eye(self.bands) - 1 / self.bands)[0][:, :self.bands - 1]
        self.start = self.expected
        mean, self._sd = self._prior(np.zeros(0), None, 0.0, False, 0.0)
        state, self._rest, self._slopes = self._fitted(_unchanged, mean, self._sd)
        self.start = self._signal(_unchanged, state)

    # the state: log gains, mixing off the diagonal, glare, field, the cause's own
    def _prior(self, own_sd: np.ndarray, own_mean: np.ndarray | None, mixing: float, matrix: bool,
               field_sd: float) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of the state; arguments as of ``evidence``."""
        off = ~np.eye(self.bands, dtype=bool)
        count = np.count_nonzero(off)
        mean, further = np.zeros(count), np.full(count, mixing)
        if matrix:
            apart = np.abs(np.subtract.outer(np.arange(self.bands), np.arange(self.bands)))[off]
            mean = np.where(apart == 1, MATRIX[0], 0.0)
            further = np.where(apart == 1, MATRIX[1], MATRIX[2])
        own = np.zeros(len(own_sd)) if own_mean is None else own_mean
        return (np.r_[np.zeros(self.bands), mean, np.zeros(self.bands + self.field.shape[1]),
                      own],
                np.r_[np.full(self.bands, GAIN_SD),
                      np.hypot(self.mixing_sd, further), np.full(self.bands, GLARE_SD),
                      np.full(self.field.shape[1], np.hypot(FIELD_SD, field_sd)), own_sd])

    def _signal(self, change: Change, state: np.ndarray) -> np.ndarray:
        bands, off = self.bands, ~np.eye(self.bands, dtype=bool)
        mixing = np.eye(bands)
        mixing[off] = state[bands:bands * bands]
        mixing = mixing / np.where(np.abs(mixing.sum(axis=0)) < 0.2, 0.2, mixing.sum(axis=0))
        at = bands * bands + bands
        field = np.exp(self.field @ state[at:at + self.field.shape[1]])
        bare = field[:, None] * (self.expected @ mixing)
        return np.asarray(change(bare, state[at + self.field.shape[1]:])
                          * np.exp(state[:bands]) + state[at - bands:at])

    def _weights(self, own: float, common: float) -> tuple[np.ndarray, float]:
        """Inverse covariance (I, K, K) of the signals, and the logarithm of its determinant."""
        high = np.maximum(self.start, OWN_DARK), np.maximum(self.start, COMMON_DARK)
        covariance = np.einsum("ik,kl->ikl", self.noise + (own * high[0]) ** 2, np.eye(self.bands))
        covariance += common**2 * high[1][:, :, None] * high[1][:, None, :]
        return np.linalg.inv(covariance), -float(np.linalg.slogdet(covariance)[1].sum())

    def _fitted(self, change: Change, mean: np.ndarray,
                sd: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The likeliest state, residuals (I, K) from the signal at the state beforehand as the
        linearised model has it, and derivatives (I, K, n).
        """
        weights, _ = self._weights(FIRST_OWN, FIRST_COMMON)
        state = mean.copy()

        def slopes_at(state: np.ndarray, signal: np.ndarray) -> np.ndarray:
            slopes = np.empty((*self.shape, len(state)))
            for one in range(len(state)):
                moved = state.copy()
                moved[one] += SMALL
                slopes[..., one] = (self._signal(change, moved) - signal) / SMALL
            return slopes

        def cost(state: np.ndarray, signal: np.ndarray) -> float:
            off = self.signal - signal
            return float(np.einsum("ik,ikl,il", off, weights, off)
                         + np.sum(((state - mean) / sd) ** 2))

        signal = self._signal(change, state)
        now = cost(state, signal)
        for _ in range(STEPS):
            slopes = slopes_at(state, signal)
            pulled = np.einsum("ikn,ikl->iln", slopes, weights)
            step = np.linalg.solve(
                np.einsum("iln,ilm->nm", pulled, slopes) + np.diag(sd**-2),
                np.einsum("iln,il->n", pulled, self.signal - signal) - (state - mean) / sd**2)
            before = now
            for _ in range(4):
                tried = state + step
                new = self._signal(change, tried)
                if np.isfinite(new).all() and (then := cost(tried, new)) < now:
                    state, signal, now = tried, new, then
                    break
                step = step / 3
            if before - now < 0.01:
                break
        slopes = slopes_at(state, signal)
        return state, self.signal - signal + slopes @ (state - mean), slopes

    def evidence(self, change: Change, own_sd: np.ndarray, own_mean: np.ndarray | None = None,
                 log_prior: float = 0.0, *, mixing: float = 0.0, matrix: bool = False,
                 field_sd: float = 0.0) -> float:
        """Log evidence of one way in which a cause changes signals, whose white is 1 in each band,
        up to a constant of the signals; with the logarithm of the way's own probability.

        Its parameters have ``own_mean`` (None: 0) and ``own_sd`` beforehand. ``mixing`` and
        ``field_sd`` are those of further mixing of the bands and of a further field; ``matrix``: to
        a narrower colour space, see ``MATRIX``.
        """
        mean, sd = self._prior(own_sd, own_mean, mixing, matrix, field_sd)
        _, residual, slopes = self._fitted(change, mean, sd)
        return log_prior + float(
            logsumexp([self._log_density(residual, slopes, sd, own, common)
                       for own in OWN_ERRORS for common in COMMON_ERRORS])
            - np.log(len(OWN_ERRORS) * len(COMMON_ERRORS)))

    def _log_density(self, residual: np.ndarray, slopes: np.ndarray, sd: np.ndarray, own: float,
                     common: float) -> float:
        weights, log_determinant = self._weights(own, common)
        pulled = np.einsum("ikn,ikl->iln", slopes, weights)
        precision = np.einsum("iln,ilm->nm", pulled, slopes) + np.diag(sd**-2)
        moved = np.einsum("iln,il->n", pulled, residual)
        chi_square = np.einsum("ik,ikl,il", residual, weights, residual) \
            - moved @ np.linalg.solve(precision, moved)
        return 0.5 * float(log_determinant - chi_square - np.linalg.slogdet(precision)[1]
                           - 2 * np.log(sd).sum())

    # ---- which of many forms to look at

    def gains(self, effects: np.ndarray, sd: float, also: np.ndarray | None = None,
              positive: bool = False) -> np.ndarray:
        """Rough nats (n,) that effects (n, I, K) of a size explain, beside others (m, I, K)."""
        weights, _ = self._weights(FIRST_OWN, FIRST_COMMON)
        slopes, sizes = self._slopes, self._sd
        if also is not None and len(also):
            slopes = np.concatenate([slopes, np.moveaxis(also, 0, -1)], axis=2)
            sizes = np.r_[sizes, np.full(len(also), sd)]
        pulled = np.einsum("ikn,ikl->iln", slopes, weights)
        precision = np.einsum("iln,ilm->nm", pulled, slopes) + np.diag(sizes**-2)
        solved = np.linalg.solve(precision, np.einsum("iln,il->n", pulled, self._rest))
        rest = np.einsum("ikl,il->ik", weights, self._rest - slopes @ solved)
        score = np.einsum("nik,ik->n", effects, rest)
        crossed = np.einsum("iln,mil->mn", pulled, effects)
        size = np.einsum("nik,ikl,nil->n", effects, weights, effects) \
            - np.einsum("mn,mn->m", crossed, np.linalg.solve(precision, crossed.T).T)
        gain = score**2 / (size + sd**-2) / 2 - np.log1p(size * sd**2) / 2
        return np.where(score > 0, gain, -np.inf) if positive else np.asarray(gain)

    def likeliest(self, effects: np.ndarray, sd: float) -> list[int]:
        """The effects (of n, I, K) that explain most by themselves."""
        return list(np.argsort(-self.gains(effects, sd))[:CANDIDATES].tolist())

    def one_by_one(self, effects: np.ndarray, sd: float, positive: bool = False
                   ) -> list[list[int]]:
        """Growing sets of effects, each with what explains most beside those before."""
        chosen: list[int] = []
        sets = []
        for _ in range(min(MOST_PATCHES, len(effects) // 4)):
            gain = self.gains(effects, sd, effects[chosen], positive)
            gain[chosen] = -np.inf
            chosen = [*chosen, int(gain.argmax())]
            sets.append(chosen)
        return sets
