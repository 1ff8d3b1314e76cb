// Stub of CHAI3D 3 for a test: the names and signatures that chai3d_tissue.cpp uses, a clock of 1 ms a call and a device that
// dips into the tissue and prints the forces that it is sent.
#ifndef STUB_OF_CHAI3D_H
#define STUB_OF_CHAI3D_H

#include <cmath>
#include <cstdio>
#include <memory>

namespace chai3d {

class cVector3d {
public:
    cVector3d() : values{0.0, 0.0, 0.0} {}
    cVector3d(const double x, const double y, const double z) : values{x, y, z} {}
    double x() const { return values[0]; }
    double y() const { return values[1]; }
    double z() const { return values[2]; }
    cVector3d operator*(const double s) const { return cVector3d(values[0] * s, values[1] * s, values[2] * s); }

private:
    double values[3];
};

struct cHapticDeviceInfo {
    double m_maxLinearForce = 8.0;
};

class cGenericHapticDevice {
public:
    bool open() { return true; }
    bool close() {
        std::puts("closed");
        return true;
    }
    bool calibrate(bool a_forceCalibration = false) { return !a_forceCalibration; }
    bool getPosition(cVector3d &a_position) {
        a_position = cVector3d(0.001 * std::sin(0.02 * calls), 0.0, -0.002 * std::sin(0.01 * calls));
        ++calls;
        return true;
    }
    bool setForce(const cVector3d &a_force) {
        std::printf("%.17g %.17g %.17g\n", a_force.x(), a_force.y(), a_force.z());
        return true;
    }
    bool getUserSwitch(int a_switchIndex, bool &a_status) {
        a_status = a_switchIndex == 0 && calls >= 200;
        return true;
    }
    cHapticDeviceInfo getSpecifications() { return cHapticDeviceInfo(); }

private:
    int calls = 0;
};

typedef std::shared_ptr<cGenericHapticDevice> cGenericHapticDevicePtr;

class cHapticDeviceHandler {
public:
    bool getDevice(cGenericHapticDevicePtr &a_device, unsigned int a_index = 0) {
        a_device = std::make_shared<cGenericHapticDevice>();
        return a_index == 0;
    }
};

class cPrecisionClock {
public:
    void start(bool a_resetClock = false) { ticks = a_resetClock ? 0 : ticks; }
    double getCurrentTimeSeconds() { return 0.001 * ticks++; }

private:
    long ticks = 0;
};

}  // namespace chai3d

#endif
