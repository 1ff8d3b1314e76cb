// A tissue model in a haptic loop, in C++11: tissue_force.h with exceptions, and freed by itself. Header only.
//
//   lumbar::TissueForce tissue("KB");                       // the folder of an unzipped KB_fmi3.fmu
//   double force = tissue.step(seconds, millimetres);       // on the device's thread, at any rate
#ifndef LUMBAR_TISSUE_FORCE_HPP
#define LUMBAR_TISSUE_FORCE_HPP

#include <functional>
#include <stdexcept>
#include <string>
#include <utility>

#include "tissue_force.h"

namespace lumbar {

class TissueForce {
public:
    using Log = std::function<void(const std::string &)>;

    /// Load the FMU in a folder; without a log it is silent. Throws std::runtime_error with what is wrong.
    explicit TissueForce(const std::string &folder, Log log = Log()) : log_(std::move(log)) {
        require(tissue_force_open(&tissue_, folder.c_str(), log_ ? logged : nullptr, this));
    }
    ~TissueForce() { tissue_force_close(&tissue_); }
    TissueForce(const TissueForce &) = delete;
    TissueForce &operator=(const TissueForce &) = delete;

    /// Force at the position measured at this time, in seconds of a clock that does not go back. Throws where time goes back or
    /// jumps; the device must then be stopped, and reset() called before the next step.
    double step(double time, double position) {
        require(tissue_force_step(&tissue_, time, position, &force_));
        return force_;
    }
    /// The same of a model of several axes: axes() numbers each.
    void step(double time, const double position[], double force[]) {
        require(tissue_force_step_along(&tissue_, time, position, force));
    }
    int axes() const { return tissue_.axes; }
    /// Begin anew, at rest; parameters that were set stay.
    void reset() { require(tissue_force_reset(&tissue_)); }
    /// Parameters by name: "gain", "force_limit", "force_offset", "position_offset" …
    void set(const std::string &name, double value) { require(tissue_force_set(&tissue_, name.c_str(), value)); }
    double get(const std::string &name) {
        double value = 0.0;
        require(tissue_force_get(&tissue_, name.c_str(), &value));
        return value;
    }
    void set_longest_gap(double seconds) { tissue_.longest_gap = seconds; }

    /// What the FMU says of itself: sampling_time, resisting_sign, and the range of motion that it was fitted to.
    const tissue_force &described() const { return tissue_; }
    /// Whether the model was fitted to positions as this one; true where it does not say.
    bool in_range(double position) const {
        return !tissue_.range_known || (position >= tissue_.lowest && position <= tissue_.highest);
    }

private:
    void require(bool done) const {
        if (!done) throw std::runtime_error(std::string("tissue force: ") + tissue_.error);
    }
    static void logged(void *context, const char *text) { static_cast<TissueForce *>(context)->log_(text); }

    tissue_force tissue_;
    Log log_;
    double force_ = 0.0;
};

}  // namespace lumbar

#endif
