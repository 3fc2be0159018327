"""Point clouds of another program's sensor: depth images and points as numpy arrays become samples on range/cloud/NAME.

Needs numpy, and beside it foreign.py and jink.py (docs/bring_your_own_process.md). Nothing in here knows where images or points
come from: pyrealsense2, OpenCV, ouster-sdk and others hand out numpy arrays.

Every ray says one of three things. A hit: an obstacle at its end. Clear: nothing between the sensor and its end, which lies at
the longest range. Unknown: nothing. What was not measured is unknown, never clear.
"""

import functools

import numpy as np

import jink
from foreign import Output

# Takes directions of cameras (right, down, along the optical axis) to those of a sensor (forward, right, down).
FRD_OF_OPTICAL = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# Takes directions of lidars and of ROS (forward, left, up) to those of a sensor.
FRD_OF_FLU = np.diag([1.0, -1.0, -1.0])

POINT = np.dtype(jink.CloudPoint)
MOST_POINTS = jink.PointCloud.points.size // POINT.itemsize
# Units of CloudPoint.offset_10us in a second.
OFFSETS_PER_S = 100_000.0


class Mounting:
    """Where a sensor sits in the body (forward, right, down; m), and how: a rotation matrix that takes its directions to the body's.

    `turns_deg` is turned in this order: to the right, then nose up, then right side down, as yaw_deg, pitch_deg and roll_deg are in
    jink.toml. `axes` are those in which the sensor's own data are given: FRD_OF_OPTICAL, FRD_OF_FLU, or none.
    """

    def __init__(self, position_m=(0.0, 0.0, 0.0), turns_deg=(0.0, 0.0, 0.0), axes=None):
        (cy, cp, cr), (sy, sp, sr) = np.cos(np.radians(turns_deg)), np.sin(np.radians(turns_deg))
        yaw = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        pitch = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        roll = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        self.position_m = np.asarray(position_m, dtype=np.float32)
        self.rotation = (yaw @ pitch @ roll @ (np.eye(3) if axes is None else axes)).astype(np.float32)


class DepthCamera:
    """Turns depth images into points.

    `size_px` is width and height, `intrinsics_px` fx, fy, cx, cy of an image without distortion: rectify others first
    (cv2.remap with INTER_NEAREST: no depth may be mixed with its neighbour's). Depths count along the optical axis, in units of
    `scale_m` where they are whole numbers, in metres where they are not. Of each block of `bin_px` x `bin_px` pixels the nearest
    depth becomes a point. Depths that hang between two surfaces are removed: what belongs to no square of 2 x 2 pixels whose
    inverse depths differ by at most `flying_per_m` (1/m; 0 = none is removed).
    """

    def __init__(self, size_px, intrinsics_px, range_m, mounting, scale_m=0.001, bin_px=5, flying_per_m=None):
        width, height = size_px
        fx, fy, cx, cy = intrinsics_px
        if not 1 <= bin_px <= 16:
            raise ValueError(f"bin_px = {bin_px}, possible are 1 to 16")
        self.shape = (height, width)
        self.range_m = range_m
        self.mounting = mounting
        self._scale_m = scale_m
        self._bin_px = bin_px
        self._rows, self._columns = height // bin_px, width // bin_px
        v, u = np.mgrid[0:height, 0:width]
        rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(self.shape)], axis=-1).reshape(-1, 3)
        self._length = np.linalg.norm(rays, axis=-1).astype(np.float32)
        self._rays = (rays @ mounting.rotation.T).astype(np.float32)
        # The number of each pixel in its block, of each block's first pixel in the image, and of each in a block from the first.
        self._in_block = ((v % bin_px) * bin_px + u % bin_px).astype(np.uint32)
        first = v[::bin_px, ::bin_px] * width + u[::bin_px, ::bin_px]
        self._first = first[: self._rows, : self._columns].reshape(-1)
        self._from_first = np.array([n // bin_px * width + n % bin_px for n in range(bin_px**2)])
        # 1 / (f h) a pixel is the steepest that a plane at distance h gets: planes from 0.11 m on are kept.
        self._greatest = _greatest_on_surface(scale_m * (9.0 / fx if flying_per_m is None else flying_per_m))

    def points(self, depths):
        """Points of a depth image: an array of its shape, 0 (or negative, infinite, no number) = unknown."""
        raw = self._raw(np.asarray(depths))
        if self._greatest is not None:
            raw = self._without_flying_pixels(raw)
        pixel, measured = self._nearest(raw)
        z_m = raw.reshape(-1)[pixel] * np.float32(self._scale_m)
        length = self._length[pixel]

        longest_m = np.float32(self.range_m[1])
        is_known = z_m > 0
        is_hit = is_known & (z_m * length <= longest_m)
        # Few far depths in a block that is unknown otherwise are not believed.
        is_clear = is_known & ~is_hit & (2 * measured >= self._bin_px**2)
        along_m = np.where(is_hit, z_m, longest_m / length)
        ends_m = self._rays[pixel] * along_m[:, np.newaxis] + self.mounting.position_m
        return _points(ends_m, is_hit, is_clear)

    def _raw(self, depths):
        """Depths in units of `scale_m` as 16 bits: whatever is farther is farther than any range."""
        if depths.shape != self.shape:
            raise ValueError(f"a depth image of {depths.shape}, not of {self.shape}")
        if depths.dtype == np.uint16:
            return depths
        if depths.dtype.kind == "f":
            is_known = np.isfinite(depths) & (depths > 0)
            depths = np.rint(np.where(is_known, depths, 0) / self._scale_m)
        return np.clip(depths, 0, 65_535).astype(np.uint16)

    def _without_flying_pixels(self, raw):
        # Least and greatest depth of the square of 2 x 2 pixels that begins in each pixel.
        low, high = np.minimum(raw[:-1], raw[1:]), np.maximum(raw[:-1], raw[1:])
        low, high = np.minimum(low[:, :-1], low[:, 1:]), np.maximum(high[:, :-1], high[:, 1:])
        is_surface = high <= self._greatest[low]
        is_kept = np.zeros(raw.shape, dtype=bool)
        for part in (is_kept[:-1, :-1], is_kept[:-1, 1:], is_kept[1:, :-1], is_kept[1:, 1:]):
            part |= is_surface
        return raw * is_kept

    def _nearest(self, raw):
        """The pixel with the least depth of each block, and how many pixels have one."""
        # A depth less one, so that none is the greatest number, and below it the pixel's number: the least of both at once.
        keys = (raw - np.uint16(1)).astype(np.uint32)
        keys <<= np.uint32(8)
        keys |= self._in_block
        least = self._reduce(np.minimum, keys)
        measured = self._reduce(np.add, (raw > 0).view(np.uint8), np.uint16)
        return self._first + self._from_first[least & 0xFF], measured

    def _reduce(self, operation, image, into=None):
        """One number for each block; what is left over at the right and the lower edge is left out."""
        b, rows, columns = self._bin_px, self._rows, self._columns
        image = image[: rows * b, : columns * b]
        lines = functools.reduce(operation, (image[n::b] for n in range(b)))
        lines = lines if into is None else lines.astype(into)
        return functools.reduce(operation, (lines[:, n::b] for n in range(b))).reshape(-1)


def _greatest_on_surface(limit):
    """For each depth the greatest beside it on one surface, in the units of the image: the inverse of both differs by `limit` at most,
    or they differ by two units, which is rounding. Nothing but 0 goes with 0. None: every depth stays."""
    if limit <= 0:
        return None
    depth = np.arange(65_536, dtype=np.float64)
    greatest = depth / np.maximum(1.0 - limit * depth, 1e-9)
    greatest = np.maximum(greatest, depth + 2)
    greatest[0] = 0
    return np.minimum(greatest, 65_535).astype(np.uint16)


class Points:
    """Turns points in the axes of `mounting` into those of the body."""

    def __init__(self, range_m, mounting):
        self.range_m = range_m
        self.mounting = mounting

    def points(self, points_m, offsets_s=None):
        """Points of an array of N x 3 (m, from the sensor). The origin itself, and what is no number, is unknown: of a lidar that has
        got nothing back. `offsets_s`: when each was measured, after the first (s)."""
        points_m = np.asarray(points_m, dtype=np.float32).reshape(-1, 3)
        if len(points_m) > MOST_POINTS:
            raise ValueError(f"{len(points_m)} points: a cloud has room for {MOST_POINTS}; keep the nearest of each few")
        range_m = np.sqrt(np.einsum("ij,ij->i", points_m, points_m))
        longest_m = np.float32(self.range_m[1])
        is_known = np.isfinite(range_m) & (range_m > 0)
        is_hit = is_known & (range_m <= longest_m)
        is_clear = is_known & ~is_hit
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.where(is_clear, longest_m / range_m, np.float32(1))
        ends_m = (points_m * factor[:, np.newaxis]) @ self.mounting.rotation.T + self.mounting.position_m
        out = _points(ends_m, is_hit, is_clear)
        if offsets_s is not None:
            offsets = np.asarray(offsets_s).reshape(-1) * OFFSETS_PER_S
            out["offset_10us"] = np.clip(offsets, 0, 65_535).astype(np.uint16)
        return out


def _points(ends_m, is_hit, is_clear):
    out = np.zeros(len(ends_m), dtype=POINT)
    is_known = is_hit | is_clear
    for index, name in enumerate(("forward_m", "right_m", "down_m")):
        out[name] = np.where(is_known, ends_m[:, index], np.float32(0))
    out["kind"] = is_hit * np.uint8(jink.RayKind.HIT) + is_clear * np.uint8(jink.RayKind.CLEAR)
    return out


class CloudOutput:
    """range/cloud/NAME of the sensor called `name` in jink.toml, whose kind begins with user/ and whose output is "cloud".

    `source` is what makes its points; `sigma_m` one standard deviation of a range. A cloud is stale two and a half periods of
    `rate_hz` and `delay_s` after its capture, the topic's own 250 ms at least.
    """

    def __init__(self, process, name, source, rate_hz, sigma_m, delay_s=0.05):
        period_s = max(2.5 / rate_hz, jink.TOPICS["range/cloud/*"].deadline_ms * 1e-3)
        self._output = Output(process, "range/cloud/*", name, deadline_us=int((period_s + delay_s) * 1e6))
        self._source = source
        self._sigma_m = sigma_m

    def publish(self, points, capture_ns, first_ns=None):
        """Publishes points of the source. `capture_ns`, `first_ns`: when the last and the first of them was measured (nanoseconds of
        CLOCK_MONOTONIC: time.monotonic_ns()); of an image both are the same."""

        def fill(address):
            cloud = jink.PointCloud.from_address(address)
            position_m = self._source.mounting.position_m
            cloud.origin.x_m, cloud.origin.y_m, cloud.origin.z_m = (float(m) for m in position_m)
            cloud.first_point = capture_ns if first_ns is None else first_ns
            cloud.range_min_m, cloud.range_max_m = self._source.range_m
            cloud.range_sigma_m = self._sigma_m
            cloud.len = len(points)
            np.frombuffer(cloud.points, dtype=POINT)[: len(points)] = points

        self._output.write(fill, capture_ns, is_measurement=True)
