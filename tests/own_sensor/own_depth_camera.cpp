// A depth camera that jink does not know, in C++: its images become point clouds on range/cloud/NAME.
//
// The images are of a wall 3 m ahead with a post 2 m ahead in front of it, in millimetres, as librealsense or OpenNI hand them out.
//
//   jink schema --c > jink.h
//   cargo build --release -p jink-own-sensor
//   c++ -std=c++17 -O2 own_depth_camera.cpp -o own_depth_camera target/release/libjink_own_sensor.a -lpthread -ldl -lm

#include "jink_sensor.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <random>
#include <vector>

namespace {

constexpr int kWidth = 848, kHeight = 480;
constexpr double kRateHz = 15.0;
constexpr float kFx = 447.0F, kFy = 447.0F, kCx = 423.5F, kCy = 239.5F;
constexpr float kScaleM = 0.001F, kRangeMinM = 0.3F, kRangeMaxM = 5.0F;
// Of each 4 x 4 pixels the nearest depth becomes a point.
constexpr int kBin = 4;
// Inverse depths within 2 x 2 pixels of one surface differ by less than this (1/m).
constexpr float kFlyingPerM = 9.0F / kFx;
// The camera sits 0.1 m ahead of the centre of gravity and looks forward.
constexpr float kForwardM = 0.1F;

struct Camera {
    std::vector<uint16_t> image = std::vector<uint16_t>(kWidth * kHeight);
    std::vector<uint16_t> kept = std::vector<uint16_t>(kWidth * kHeight);
    std::minstd_rand random{1};
    uint64_t due_ns = 0;
    std::vector<double> took_ms;
};

// What the SDK of a real camera does.
void capture(Camera &camera) {
    for (int row = 0; row < kHeight; ++row) {
        for (int column = 0; column < kWidth; ++column) {
            const bool is_post = column >= 410 && column < 440;
            const auto noise = static_cast<int>(camera.random() % 21) - 10;
            const bool is_hole = camera.random() % 20 == 0;
            const int mm = (is_post ? 2000 : 3000) + noise;
            camera.image[row * kWidth + column] = is_hole ? 0 : static_cast<uint16_t>(mm);
        }
    }
}

bool is_surface(const uint16_t *upper, const uint16_t *lower) {
    const auto low = std::min({upper[0], upper[1], lower[0], lower[1]});
    const auto high = std::max({upper[0], upper[1], lower[0], lower[1]});
    const auto limit = kFlyingPerM * kScaleM * static_cast<float>(low) * static_cast<float>(high);
    return low > 0 && static_cast<float>(high - low) <= std::max(limit, 2.0F);
}

// Keeps what belongs to a square of 2 x 2 pixels of one surface.
void remove_flying_pixels(Camera &camera) {
    std::fill(camera.kept.begin(), camera.kept.end(), 0);
    for (int row = 0; row + 1 < kHeight; ++row) {
        for (int column = 0; column + 1 < kWidth; ++column) {
            const int at = row * kWidth + column;
            if (is_surface(&camera.image[at], &camera.image[at + kWidth])) {
                for (const int pixel : {at, at + 1, at + kWidth, at + kWidth + 1}) {
                    camera.kept[pixel] = camera.image[pixel];
                }
            }
        }
    }
}

jink_cloud_point_t point_of(const Camera &camera, int bin_row, int bin_column) {
    uint16_t nearest = 0;
    int measured = 0, nearest_row = 0, nearest_column = 0;
    for (int row = bin_row * kBin; row < (bin_row + 1) * kBin; ++row) {
        for (int column = bin_column * kBin; column < (bin_column + 1) * kBin; ++column) {
            const uint16_t depth = camera.kept[row * kWidth + column];
            measured += depth != 0;
            if (depth != 0 && (nearest == 0 || depth < nearest)) {
                nearest = depth;
                nearest_row = row;
                nearest_column = column;
            }
        }
    }
    jink_cloud_point_t point{};
    const float right = (static_cast<float>(nearest_column) - kCx) / kFx;
    const float down = (static_cast<float>(nearest_row) - kCy) / kFy;
    const float length = std::sqrt(1.0F + right * right + down * down);
    float along_m = static_cast<float>(nearest) * kScaleM;
    point.kind = JINK_RAY_KIND_HIT;
    if (along_m * length > kRangeMaxM) {
        along_m = kRangeMaxM / length;
        point.kind = JINK_RAY_KIND_CLEAR;
    }
    // Zero is unknown, and a few far depths in an unknown block are not believed.
    if (nearest == 0 || (point.kind == JINK_RAY_KIND_CLEAR && 2 * measured < kBin * kBin)) {
        return jink_cloud_point_t{};
    }
    point.forward_m = kForwardM + along_m;
    point.right_m = along_m * right;
    point.down_m = along_m * down;
    return point;
}

extern "C" int next(void *context, uint64_t now_ns, uint64_t *capture_ns) {
    auto &camera = *static_cast<Camera *>(context);
    if (now_ns < camera.due_ns) {
        return 0;
    }
    camera.due_ns = std::max(camera.due_ns, now_ns) + static_cast<uint64_t>(1e9 / kRateHz);
    capture(camera);
    *capture_ns = now_ns;
    return 1;
}

extern "C" void fill(void *context, jink_point_cloud_t *cloud) {
    auto &camera = *static_cast<Camera *>(context);
    const auto begin = std::chrono::steady_clock::now();
    remove_flying_pixels(camera);
    cloud->origin = {kForwardM, 0.0, 0.0};
    cloud->range_min_m = kRangeMinM;
    cloud->range_max_m = kRangeMaxM;
    cloud->range_sigma_m = 0.09F;
    std::fill(std::begin(cloud->reserved), std::end(cloud->reserved), 0);
    uint32_t len = 0;
    for (int row = 0; row < kHeight / kBin; ++row) {
        for (int column = 0; column < kWidth / kBin; ++column) {
            cloud->points[len++] = point_of(camera, row, column);
        }
    }
    cloud->len = len;
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - begin;
    camera.took_ms.push_back(took.count());
    if (camera.took_ms.size() == 150) {
        std::sort(camera.took_ms.begin(), camera.took_ms.end());
        std::printf("%.1f / %.1f ms from image to cloud (p50 / p99)\n", camera.took_ms[75], camera.took_ms[148]);
        std::fflush(stdout);
        camera.took_ms.clear();
    }
}

} // namespace

int main() {
    Camera camera;
    const jink_cloud_sensor_t sensor{kRateHz, 100, &camera, next, fill};
    return jink_cloud_run(&sensor);
}
