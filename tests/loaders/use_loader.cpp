// What a C++ program may do with tissue_force.hpp, right and wrong; prints what came of it.
#include <cstdio>
#include <fstream>
#include <iostream>

#include "tissue_force.hpp"

static bool is_loaded(const std::string &library) {
    std::ifstream maps("/proc/self/maps");
    for (std::string line; std::getline(maps, line);) {
        if (line.find(library) != std::string::npos) return true;
    }
    return false;
}

template <typename Action>
static void refused(const char *what, Action action) {
    try {
        action();
        std::cout << what << ": nothing\n";
    } catch (const std::runtime_error &error) {
        std::cout << what << ": " << error.what() << "\n";
    }
}

int main(int, char *arguments[]) {
    const std::string folder = arguments[1], library = arguments[2];
    {
        lumbar::TissueForce tissue(folder), other(folder, [](const std::string &text) { std::cout << "log: " << text << "\n"; });
        const tissue_force &said = tissue.described();
        std::printf("described: %g %d %d %g %g %g %g %g\n", said.sampling_time, said.resisting_sign, said.range_known, said.lowest,
                    said.highest, said.speed, said.lowest_Hz, said.highest_Hz);
        std::printf("in range: %d %d\n", tissue.in_range(1.0), tissue.in_range(99.0));
        tissue.set("force_limit", 5.0);
        const double first = tissue.step(100.0, 0.0), second = tissue.step(100.01, 1.0);
        refused("back", [&] { tissue.step(99.0, 1.0); });
        refused("pause", [&] { tissue.step(103.0, 1.0); });
        refused("no time", [&] { tissue.step(NAN, 1.0); });
        refused("too much", [&] { other.set("force_limit", 99.0); });
        refused("quietly too much", [&] { tissue.set("force_limit", 99.0); });
        refused("no parameter", [&] { tissue.set("stiffness", 1.0); });
        refused("an output", [&] { tissue.set("force", 1.0); });
        const double held = tissue.step(100.015, NAN);
        std::printf("forces: %.17g %.17g %.17g\n", first, second, held);
        tissue.reset();
        refused("no first position", [&] { tissue.step(0.0, NAN); });
        const double first_again = tissue.step(0.0, 0.0), second_again = tissue.step(0.01, 1.0);
        std::printf("again: %.17g %.17g limit %g\n", first_again, second_again, tissue.get("force_limit"));
        std::printf("loaded: %d\n", is_loaded(library));
    }
    std::printf("loaded: %d\n", is_loaded(library));
    refused("no folder", [] { lumbar::TissueForce absent("absent"); });
    refused("FMI 2.0", [&] { lumbar::TissueForce old(arguments[3]); });
    refused("no library", [&] { lumbar::TissueForce empty(arguments[4]); });
    return 0;
}
