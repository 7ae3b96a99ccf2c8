"""Tuned numbers of the geometry of a route: once for C, once for Python."""

from typing import NamedTuple


class OutlierLimits(NamedTuple):
    """Limits on residuals; lengths are in spacings of the points."""

    share: float = 0.1
    """Most outliers of all values, or of those side by side; where there are more, the fit, or the order, is
    wrong [1]; chosen. The largest deviations that do not determine the spread of inputs of a batch."""

    bend_share: float = 0.3
    """Residual over κh² that a jump of curvature alone gives a point of a smooth curve [1]; chosen."""
    bend_share_at_end: float = 2.0
    """The same at the first and last point, which have neighbours on one side only, and half of it one point
    farther in [1]; chosen."""
    sharpest: float = 1.0
    """Greatest turn from point to point in this test [rad]; chosen: a sharper one comes from an outlier."""
    neighbours: int = 3
    """Points on either side among which only the worst becomes an outlier at once [1]; chosen."""
    turn_share: float = 0.5
    """Residual of a direction over the turn from point to point that a jump of curvature alone gives [1];
    chosen."""

    longest_run: int = 4
    """Outliers side by side, in a fit or before it, beyond which they are an end of the route or a break in
    the sequence; twice as many between points that are none are the route [1]; chosen."""


OUTLIERS = OutlierLimits()


class RawOutlierLimits(NamedTuple):
    """Which points are outliers before any fit, judged by their neighbours alone."""

    end_off_direction: float = 15.0
    """Typical distances by which an end must leap aside to be an outlier [1]. Chosen."""
    end_off_curve: float = 0.1
    """Residual of the last five points on their parabola, from which an end is tested [spacings]. Chosen."""
    end_leap: float = 1.5
    """Step from an end to its neighbour that is a leap [spacings]. Chosen."""
    end_leap_aside: float = 0.6
    """Share of such a step that must go aside [1]. Chosen."""
    end_too_far: float = 6.0
    """Step from an end to its neighbour that no bend explains [spacings]. Chosen."""
    most_discount: float = 4.0
    """Factor by which a leap longer than the way that shows the direction counts less at most [1]. Chosen."""
    end_improvement: float = 0.3
    """Residual without the outlier over that with it, at most [1]. Chosen."""
    extrapolated_from: int = 6
    """Points whose line is extrapolated beyond an end. Chosen."""
    fewest: int = 8
    """Fewest points among which outliers and the order of all can be judged [1]. Chosen."""


RAW = RawOutlierLimits()


class PointLimits(NamedTuple):
    """Which coordinates can be those of a route."""

    least_extent: float = 1e-6
    """Extent below which points have none, and distance from a wall that every point is allowed [m]. Chosen:
    below any tendon. Points so far from the origin that their rounding is more are refused."""
    usual_least: float = 1e-3
    """Extent below which the unit may be wrong [m]. Chosen."""
    usual_most: float = 100.0
    """Extent above which the unit may be wrong [m]. Chosen."""
    few: int = 40
    """Points up to which λ is averaged over and a wrong order is searched for, and from which little noise is
    evidence [1]. Chosen: more determine λ to a small part of the error of Φ; the search takes 3 ms."""


POINTS = PointLimits()


class OrderingLimits(NamedTuple):
    """Whether points follow each other along a route."""

    wandering: float = 0.9
    """Median step over the median distance from the mean of a sequence that may be at random [1]. Chosen."""
    nearer_neighbours: float = 3.0
    """Median step over the median distance to the nearest point of one at random [1]. Chosen."""
    leap: float = 10.0
    """Median steps that make a leap, if longer than the median distance from the mean [1]. Chosen."""
    elsewhere: float = 2.0
    """Median steps around the ends of a leap in which no other part of the route may lie [1]. Chosen."""


ORDERING = OrderingLimits()


class SpacingRule(NamedTuple):
    """How unevenly points may lie along a route, and which spacing bounds the length of a piece there."""

    crowd_quantile: float = 0.3
    """Quantile of the steps that represents the denser part [1]. Chosen."""
    uneven: float = 4.0
    """Steps by which points may be off along the route, either way: before a fit, from known stations on a
    chain, and by noise before corners are sought; points apart in the sequence up to which they may be near
    each other; and most times the step of the denser part which the mean spacing may count as [1]. Chosen."""


SPACING = SpacingRule()


class SplinePrior(NamedTuple):
    """What the prior of a smooth route may follow. Lengths in spacings of the points."""

    sharpest: float = 1.5
    """Greatest turn from point to point that the prior follows [rad]; chosen."""
    change: float = 0.5
    """Greatest relative change of curvature, or turn of its plane [rad], from point to point; chosen."""
    rounding: float = 1e-6
    """Least noise, which every residual is allowed too, and least distance of neighbouring stations whose
    feet coincide [spacing]; chosen: less is rounding, not truth, to a filter of four states."""
    vague: float = 1e4
    """Variance of position and direction at the first station over that of the last pass or guess [1];
    chosen."""
    vague_bend: float = 4.0
    """Variance of a and b at both ends over that of the first guess [1]; chosen."""
    guess_points: int = 9
    """Points between whose chords the first guess of the curvature is taken [1]; chosen."""


PRIOR = SplinePrior()


class RatioSearch(NamedTuple):
    """Where the smoothing ratio λ is searched, and how closely. λ in decades, of units of the spacing."""

    least: float = -8.0
    """Least λ [decades]: interpolation; chosen."""
    most: float = 20.0
    """Greatest λ [decades]: one cubic through a thousand points and more; chosen."""
    coarse: float = 2.0
    """Distance of the first trials [decades]; chosen."""
    fine: float = 0.4
    """Half width of the last parabola [decades]; derived: a twentieth of the smoother's window."""
    price_per_decade: float = 1.0
    """-2 ln of the prior of λ by decade [1]; chosen: no route is taken for exactly linear in curvature."""


SEARCH = RatioSearch()


class SplinePasses(NamedTuple):
    """How many passes a fit takes, each with its prior along the curve of the last one, and when they end."""

    most: int = 12
    """Most passes, and most fits without the outliers of the one before [1]; chosen: at a kink no pass is the
    last."""
    same_ratio: float = 0.05
    """Change of ln λ at which they have converged, and of the noise of directions that makes no new fit, over
    it [1]; chosen."""
    uneven: float = 2.0
    """ln likelihood of a point by which chord lengths must beat even spacing as first stations [1];
    chosen."""
    representative: float = 0.05
    """Posterior over the greatest one of a fit that may stand for all, and of a noise that may be kept [1];
    chosen."""
    warm_noise: float = 2.0
    """Factor on the noise variance of the last fit, beyond which a fit begins from nothing or keeps that
    noise, and above which a chain is unfit [1]; chosen."""


PASSES = SplinePasses()


class AngleErrors(NamedTuple):
    """Errors of Φ beside those of the posterior; docs/model.md (26)."""

    natural_ends: float = 1e-3
    """Relative error of an exact circle over the fourth power of its turn a point [1/rad⁴]. Fitted."""
    sparse: float = 0.1
    """Standard error for each rad⁵ of uneven turns from point to point [rad/rad⁵]. Fitted; model.md (26)."""
    most_sparse: float = 0.3
    """Share of Φ up to which that counts [1]. Chosen: priors of the curvature hold what is more;
    model.md (26)."""
    typical_peak: float = 2.0
    """Peak of the rate of curvature over its root mean square on smooth routes [1]. Fitted; model.md (26)."""
    lost: float = 0.33
    """Share of a sharper peak that smoothing takes away [1]. Fitted; model.md (26)."""
    few_parameters: float = 7.0
    """Parameters from which a prior is known to its own size [1]. Fitted; model.md (26)."""
    unobserved: float = 5.0
    """Mean spacings between points, from which what lies between is a guess [1]. Chosen."""
    rectified: float = 0.3
    """Share of the Rician excess taken as one standard error [1]. Fitted; model.md (26)."""


ANGLE_ERRORS = AngleErrors()


class Staircase(NamedTuple):
    """How smooth curvature is cut into pieces of constant curvature; docs/model.md (27)."""

    most_cells: int = 400
    """Cells on which joints may lie, and those of a route at a resolution [1]. Chosen: by speed, the cut
    takes time quadratic in them."""
    least_step: float = 0.03
    """Steps of curvature below which a piece is not worth it, over the greatest curvature [1]. Chosen."""


STAIRCASE = Staircase()


class NodeRule(NamedTuple):
    """On how many nodes a smooth route is evaluated."""

    fewest: int = 120
    """Fewest nodes of a spline and of a draw of a fibre [1]; chosen: a turn of a helix then has some ten."""


NODES = NodeRule()


class TimeFilterLimits(NamedTuple):
    """How a filter in time changes its motion, and what it takes for noise; docs/model.md (157)."""

    neighbour: float = 1e-2
    """Probability of going to the next calmer or livelier motion in one frame [1]. Chosen."""
    start: float = 1e-3
    """Probability of going to any other livelier one [1]. Chosen."""
    prior_values: float = 50.0
    """Values for which the noise of the rest counts in that of the smooth part [1]. Chosen: two frames."""
    most_values: float = 3000.0
    """Most values of the past that count in the noise [1]. Chosen: it is known to 3 % and may change."""


TIME_FILTER = TimeFilterLimits()
