// Inserts clouds into an OcTree and writes how long each took, and at last the occupancy of a window of cells.
//
// Usage: insert INPUT OUTPUT. Both files are little endian.
//   INPUT    f64 resolution (m), f64 maximum range (m), i32[3] smallest cell of the window, i32[3] its size, u32 number of clouds;
//            per cloud: f32[3] origin, u32 number of points, f32[3] of each point. All coordinates are local (m).
//   OUTPUT   per cloud: u64 wall ns, u64 CPU ns of insertPointCloud as its defaults are; then per cell, x fastest: u8 0 unknown,
//            1 free, 2 occupied.
#include <octomap/OcTree.h>
#include <octomap/octomap.h>

#include <cstdint>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <stdexcept>
#include <vector>

namespace {

template <typename T>
T get(std::ifstream& in) {
    T value;
    if (!in.read(reinterpret_cast<char*>(&value), sizeof value)) {
        throw std::runtime_error("the input ends early");
    }
    return value;
}

std::uint64_t now_ns(clockid_t clock) {
    timespec time{};
    clock_gettime(clock, &time);
    return static_cast<std::uint64_t>(time.tv_sec) * 1000000000u + static_cast<std::uint64_t>(time.tv_nsec);
}

struct Times {
    std::uint64_t wall_ns;
    std::uint64_t cpu_ns;
};

Times insert(octomap::OcTree& tree, const octomap::Pointcloud& cloud, const octomap::point3d& origin, double range_m) {
    const auto wall = now_ns(CLOCK_MONOTONIC);
    const auto cpu = now_ns(CLOCK_THREAD_CPUTIME_ID);
    tree.insertPointCloud(cloud, origin, range_m);
    return {now_ns(CLOCK_MONOTONIC) - wall, now_ns(CLOCK_THREAD_CPUTIME_ID) - cpu};
}

void run(const char* input, const char* output) {
    std::ifstream in(input, std::ios::binary);
    std::ofstream out(output, std::ios::binary);
    const auto resolution_m = get<double>(in);
    const auto range_m = get<double>(in);
    std::int32_t min[3], size[3];
    for (auto& value : min) value = get<std::int32_t>(in);
    for (auto& value : size) value = get<std::int32_t>(in);
    const auto clouds = get<std::uint32_t>(in);

    octomap::OcTree tree(resolution_m);
    for (std::uint32_t i = 0; i < clouds; ++i) {
        const auto x = get<float>(in), y = get<float>(in), z = get<float>(in);
        const octomap::point3d origin(x, y, z);
        std::vector<float> values(std::size_t{3} * get<std::uint32_t>(in));
        if (!in.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(float)))) {
            throw std::runtime_error("the input ends early");
        }
        octomap::Pointcloud cloud;
        cloud.reserve(values.size() / 3);
        for (std::size_t k = 0; k < values.size(); k += 3) {
            cloud.push_back(values[k], values[k + 1], values[k + 2]);
        }
        const auto times = insert(tree, cloud, origin, range_m);
        out.write(reinterpret_cast<const char*>(&times), sizeof times);
    }
    for (int z = 0; z < size[2]; ++z) {
        for (int y = 0; y < size[1]; ++y) {
            for (int x = 0; x < size[0]; ++x) {
                const auto* node = tree.search((min[0] + x + 0.5) * resolution_m, (min[1] + y + 0.5) * resolution_m,
                                               (min[2] + z + 0.5) * resolution_m);
                out.put(static_cast<char>(node == nullptr ? 0 : tree.isNodeOccupied(node) ? 2 : 1));
            }
        }
    }
    if (!out.flush()) {
        throw std::runtime_error("the output cannot be written");
    }
}

}  // namespace

int main(int count, char** arguments) {
    if (count != 3) {
        std::fprintf(stderr, "usage: insert INPUT OUTPUT\n");
        return 2;
    }
    try {
        run(arguments[1], arguments[2]);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
    return 0;
}
