"""How quickly does a frame become blobs, beside the pipeline of the report and beside the best that OpenCV alone can do?

Three colours; 10 robots with 5 markers each on a carpet with lines, a light gradient, clutter beside the field and noise, at 640x480 and at
1920x1080, drawn here from a fixed seed. All candidates have to find the same 50 markers before any is timed.

- *report*: as printed. BGR to HSV, then for each colour the Mahalanobis distance of every pixel in float64, threshold, erode once, dilate
  twice, contours, smallest enclosing circles.
- *OpenCV*: routes of OpenCV calls alone: the colours as boxes, in HSV or in BGR, or as bits that a table per channel gives; one mask per
  colour or all merged; components with statistics, or contours with moments. Which is quickest depends on the machine.
- *pieper*: `segment`, with and without refined centroids; the table is made of the report's own Gaussians.

    python benchmarks/segmentation.py [--rounds 41]
"""

import argparse
import statistics
from collections.abc import Callable
from typing import NamedTuple

import paired

# isort: split
import cv2
import numpy as np
import results
from cv2.typing import MatLike

from pieper._native import kernels
from pieper.perception.color_table import ColorTable
from pieper.perception.report import gaussian_mask
from pieper.perception.segment import segment

COLORS = {"red": (25, 75, 225), "blue": (225, 80, 30), "green": (60, 225, 40)}
SIZES = {"640x480": (480, 640, 7.0), "1920x1080": (1080, 1920, 11.5)}
NOISE = 4.0
DISTANCE = 5.0  # Mahalanobis, of the report's masks
LEAST = 40  # px, area of a blob
APART = {"report": 1.5, "OpenCV": 0.6, "pieper": 0.6}  # px from the truth at most; enclosing circles are cut to int

Points = dict[str, np.ndarray]
"""Centres of the markers of each colour, (n, 2)."""


class Scene(NamedTuple):
    image: np.ndarray
    centers: Points


def scene(height: int, width: int, radius: float) -> Scene:
    """Draw the frame; discs are anti-aliased by drawing at four times the size."""
    rng = np.random.default_rng(height)
    y, x = np.mgrid[:height, :width].astype(np.float32)
    light = 0.85 + 0.3 * x / width
    frame = np.array([62.0, 108.0, 70.0]) * light[..., None]
    frame[np.abs(y - height / 2) < 2] = frame[np.abs(x - width / 2) < 2] = (215, 215, 215)
    for _ in range(40):  # things beside the field: grey, brown, dull colours
        left, top = rng.integers(0, width), rng.choice([0, height - height // 12]) + rng.integers(0, height // 12)
        shade = rng.uniform(30, 190) + rng.uniform(-30, 30, 3)
        frame[top : top + height // 20, left : left + width // 25] = shade
    centers: dict[str, list[tuple[float, float]]] = {name: [] for name in COLORS}
    robot = 3.6 * radius
    names = list(COLORS)
    for k in range(10):
        cx = width * (k % 5 + 0.5) / 5 + rng.uniform(-radius, radius)
        cy = height * (0.3 + 0.4 * (k // 5)) + rng.uniform(-radius, radius)
        _blend(frame, cx, cy, robot, (28, 28, 28))
        turn = rng.uniform(0, 2 * np.pi)
        for j in range(5):
            angle = turn + j * np.pi / 2
            away = 0.0 if j == 4 else 2.45 * radius
            mx, my = cx + away * np.cos(angle), cy + away * np.sin(angle)
            name = names[(k + j) % 3]
            _blend(frame, mx, my, radius, COLORS[name])
            centers[name].append((mx, my))
    frame = cv2.GaussianBlur(frame, (3, 3), 0.5) + rng.normal(0, NOISE, frame.shape)
    image = np.clip(np.rint(frame), 0, 255).astype(np.uint8)
    return Scene(image, {name: np.array(points) for name, points in centers.items()})


def _blend(frame: np.ndarray, x: float, y: float, radius: float, color: tuple[int, int, int]) -> None:
    left, top, side = int(x - radius) - 2, int(y - radius) - 2, 2 * int(radius) + 7
    at = (np.arange(8 * side) + 0.5) / 8 - 0.5
    inside = (at[None] + left - x) ** 2 + (at[:, None] + top - y) ** 2 <= radius**2
    cover = inside.reshape(side, 8, side, 8).mean(axis=(1, 3))[..., None]
    part = frame[top : top + side, left : left + side]
    part[:] = part * (1 - cover) + cover * np.array(color)


# ---- the report


def gaussians(where: Scene) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Mean and covariance in HSV of a square of pixels of the first two markers of each colour."""
    hsv = cv2.cvtColor(where.image, cv2.COLOR_BGR2HSV)
    models = {}
    for name, points in where.centers.items():
        parts = [hsv[int(y) - 3 : int(y) + 4, int(x) - 3 : int(x) + 4].reshape(-1, 3) for x, y in points[:2]]
        pixels = np.concatenate(parts).astype(float)
        models[name] = (pixels.mean(axis=0), np.cov(pixels.T) + np.diag([1.0, 9.0, 9.0]))
    return models


def report(models: dict[str, tuple[np.ndarray, np.ndarray]], radius: float) -> Callable[[np.ndarray], Points]:
    kernel = np.ones((3, 3), np.uint8)

    def run(image: np.ndarray) -> Points:
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        found = {}
        for name, (mean, covariance) in models.items():
            mask = gaussian_mask(hsv, mean, covariance, DISTANCE)
            mask = cv2.dilate(cv2.erode(mask, kernel, iterations=1), kernel, iterations=2)
            contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
            circles = [cv2.minEnclosingCircle(contour) for contour in contours]
            found[name] = np.array([(int(x), int(y)) for (x, y), r in circles if 0.6 * radius < r < 1.7 * radius])
        return found

    return run


# ---- OpenCV alone


def boxes(where: Scene, *, hsv: bool) -> dict[str, tuple[tuple[int, ...], tuple[int, ...]]]:
    """Least and largest bytes of each colour: those of its markers' middles, and a margin."""
    pixels = cv2.cvtColor(where.image, cv2.COLOR_BGR2HSV) if hsv else where.image
    margin = np.array([5, 60, 60]) if hsv else np.array([45, 45, 45])
    found = {}
    for name, points in where.centers.items():
        middle = np.concatenate(
            [pixels[int(y) - 3 : int(y) + 4, int(x) - 3 : int(x) + 4].reshape(-1, 3) for x, y in points]
        )
        low = np.clip(middle.min(axis=0) - margin, 0, 255)
        high = np.clip(middle.max(axis=0).astype(int) + margin, 0, 255)
        found[name] = (tuple(map(int, low)), tuple(map(int, high)))
    return found


def opencv_routes(where: Scene) -> dict[str, Callable[[np.ndarray], Points]]:
    names = list(COLORS)
    in_hsv, in_bgr = boxes(where, hsv=True), boxes(where, hsv=False)
    bits = np.zeros((256, 1, 3), np.uint8)
    for k, name in enumerate(names):
        for channel in range(3):
            bits[in_bgr[name][0][channel] : in_bgr[name][1][channel] + 1, 0, channel] |= 1 << k

    def masks_hsv(image: np.ndarray) -> list[MatLike]:
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        return [cv2.inRange(hsv, *in_hsv[name]) for name in names]

    def masks_bgr(image: np.ndarray) -> list[MatLike]:
        return [cv2.inRange(image, *in_bgr[name]) for name in names]

    def union(masks: list[MatLike]) -> MatLike:
        together = cv2.bitwise_or(masks[0], masks[1])
        return cv2.bitwise_or(together, masks[2], together)

    def labels_by_table(image: np.ndarray) -> MatLike:
        """Bit k of a pixel is set where it has colour k."""
        b, g, r = cv2.split(cv2.LUT(image, bits))
        return cv2.bitwise_and(cv2.bitwise_and(b, g, b), r, b)

    def components(mask: MatLike) -> np.ndarray:
        _, _, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=cv2.CV_16U)
        return centroids[1:][stats[1:, cv2.CC_STAT_AREA] >= LEAST]

    def contours(mask: MatLike) -> np.ndarray:
        centers = []
        for contour in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
            m = cv2.moments(contour)
            if m["m00"] >= LEAST - len(contour) / 2:  # the polygon runs through the middles of the pixels at the edge
                centers.append((m["m10"] / m["m00"], m["m01"] / m["m00"]))
        return np.array(centers).reshape(-1, 2)

    def sort_by_mask(centers: np.ndarray, masks: list[MatLike]) -> Points:
        column, row = np.rint(centers).astype(int).T
        return {name: centers[mask[row, column] > 0] for name, mask in zip(names, masks, strict=True)}

    def sort_by_bits(centers: np.ndarray, labels: MatLike) -> Points:
        column, row = np.rint(centers).astype(int).T
        here = labels[row, column]
        return {name: centers[here == 1 << k] for k, name in enumerate(names)}

    def apart(masks: Callable[[np.ndarray], list[MatLike]], find: Callable[[MatLike], np.ndarray]) -> Callable:
        return lambda image: {name: find(mask) for name, mask in zip(names, masks(image), strict=True)}

    def merged(masks: Callable[[np.ndarray], list[MatLike]], find: Callable[[MatLike], np.ndarray]) -> Callable:
        def run(image: np.ndarray) -> Points:
            each = masks(image)
            return sort_by_mask(find(union(each)), each)

        return run

    def by_table(find: Callable[[MatLike], np.ndarray]) -> Callable:
        def run(image: np.ndarray) -> Points:
            labels = labels_by_table(image)
            return sort_by_bits(find(labels), labels)

        return run

    return {
        "HSV boxes, components of each mask": apart(masks_hsv, components),
        "HSV boxes, merged, components": merged(masks_hsv, components),
        "HSV boxes, merged, contours": merged(masks_hsv, contours),
        "BGR boxes, components of each mask": apart(masks_bgr, components),
        "BGR boxes, contours of each mask": apart(masks_bgr, contours),
        "BGR boxes, merged, components": merged(masks_bgr, components),
        "BGR boxes, merged, contours": merged(masks_bgr, contours),
        "table per channel, components": by_table(components),
        "table per channel, contours": by_table(contours),
    }


# ---- pieper


def table_of(models: dict[str, tuple[np.ndarray, np.ndarray]]) -> ColorTable:
    """The report's Gaussians as a table: each cell has the colour of its middle."""
    middle = (np.arange(64) * 4 + 2).astype(np.uint8)
    cells = np.stack(np.meshgrid(middle, middle, middle, indexing="ij"), axis=-1).reshape(512, 512, 3)
    hsv = cv2.cvtColor(cells, cv2.COLOR_BGR2HSV).astype(float)
    distances = []
    for mean, covariance in models.values():
        difference = hsv - mean
        distances.append(np.sqrt(np.sum(difference @ np.linalg.inv(covariance) * difference, axis=2)))
    nearest = np.argmin(distances, axis=0)
    labels = np.where(np.min(distances, axis=0) < DISTANCE, nearest + 1, 0)
    return ColorTable(tuple(models), labels.reshape(64, 64, 64))


def ours(table: ColorTable, *, refine: bool) -> Callable[[np.ndarray], object]:
    return lambda image: segment(image, table, min_area=LEAST, refine=refine)


def points_of(found: object) -> Points:
    if isinstance(found, dict):
        return found
    return {name: found.of(name).centroid for name in COLORS}  # type: ignore[attr-defined]


def same_markers(name: str, found: Points, where: Scene) -> float:
    """Every marker once and nothing else; the root mean square of the distances."""
    limit = APART[name.partition(":")[0]]
    squares: list[float] = []
    for color, centers in where.centers.items():
        got = np.asarray(found[color], dtype=float).reshape(-1, 2)
        assert len(got) == len(centers), f"{name}: {len(got)} {color} markers instead of {len(centers)}"
        distance = np.linalg.norm(got[:, None] - centers[None], axis=-1)
        assert len(set(distance.argmin(axis=1))) == len(centers), name
        assert distance.min(axis=1).max() <= limit, (name, color, distance.min(axis=1).max())
        squares.extend(distance.min(axis=1) ** 2)
    return float(np.sqrt(np.mean(squares)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=41)
    options = parser.parse_args()
    paired.pin_to_one_core()
    cv2.setNumThreads(1)

    sizes = {}
    for size, (height, width, radius) in SIZES.items():
        where = scene(height, width, radius)
        models = gaussians(where)
        table = table_of(models)
        candidates: dict[str, Callable[[np.ndarray], object]] = {"report": report(models, radius)}
        candidates |= {f"OpenCV: {name}": run for name, run in opencv_routes(where).items()}
        candidates["pieper: area centroid"] = ours(table, refine=False)
        candidates["pieper"] = ours(table, refine=True)
        errors = {name: same_markers(name, points_of(run(where.image)), where) for name, run in candidates.items()}
        # a figure below a tenth of a millisecond is near the clock's own cost: several frames in a row
        repeats = {name: 1 if name == "report" else 5 for name in candidates}

        def repeated(run: Callable[[np.ndarray], object], image: np.ndarray, count: int) -> Callable[[], None]:
            def several() -> None:
                for _ in range(count):
                    run(image)

            return several

        seconds = paired.in_turn(
            {name: repeated(run, where.image, repeats[name]) for name, run in candidates.items()}, rounds=options.rounds
        )
        each = {name: [value / repeats[name] for value in values] for name, values in seconds.items()}
        best = min((n for n in each if n.startswith("OpenCV")), key=lambda name: statistics.median(each[name]))
        rows = [
            {"name": name, "milliseconds": paired.quartiles([1e3 * v for v in each[name]]), "rms_px": errors[name]}
            for name in each
        ]
        sizes[size] = {
            "rows": rows,
            "best_opencv": best,
            "report / pieper": paired.ratio(each["report"], each["pieper"]),
            "best OpenCV / pieper": paired.ratio(each[best], each["pieper"]),
            "best OpenCV / pieper, area centroid": paired.ratio(each[best], each["pieper: area centroid"]),
        }
        print(size)
        for row in sorted(rows, key=lambda row: row["milliseconds"]["median"]):
            print(f"  {row['name']:44} {row['milliseconds']['median']:9.3f} ms   centres {row['rms_px']:.3f} px")
        for name, value in sizes[size].items():
            if "/" in name:
                print(f"  {name:44} {value['median']:9.2f}")

    results.save(
        "segmentation",
        method=f"one frame, 3 colours, 50 markers; one core, processor time; {options.rounds} rounds in turn, medians; ratios "
        "round by round; every candidate finds the same markers",
        packages=["opencv-python-headless"],
        instruction_set=kernels.instruction_set(),
        asked={"640x480": 0.8, "1920x1080": 5.0, "report / pieper": 100, "best OpenCV / pieper": 2},
        sizes=results.rounded(sizes),
    )


if __name__ == "__main__":
    main()
