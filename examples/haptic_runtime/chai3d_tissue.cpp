// A tissue model on any device that CHAI3D knows: the tip of the device presses into tissue below the plane z = 0.
//
//   c++ -std=c++11 -O2 -I chai3d/src chai3d_tissue.cpp -o chai3d_tissue -lchai3d -ldl … (as CHAI3D's own examples)
//   ./chai3d_tissue KB                     the folder of an unzipped KB_fmi3.fmu
//
// It runs until the device's first button is pressed. CHAI3D has metres and newtons and z up; the model has mm, and a growing
// position is a push. The axes x, y and z of a model of three are the device's.
#include <iostream>

#include "chai3d.h"
#include "tissue_force.hpp"

static const double MILLIMETRES_PER_METRE = 1000.0;

static void press(chai3d::cGenericHapticDevicePtr device, lumbar::TissueForce &tissue) {
    chai3d::cPrecisionClock clock;
    chai3d::cVector3d position;
    bool button = false;
    clock.start(true);
    while (!button && device->getPosition(position)) {
        const double time = clock.getCurrentTimeSeconds();
        if (tissue.axes() == 3) {
            const chai3d::cVector3d moved = position * MILLIMETRES_PER_METRE;
            const double at[] = {moved.x(), moved.y(), moved.z()};
            double force[3];
            tissue.step(time, at, force);
            // The model's force resists the motion: on the tip it acts against it.
            device->setForce(chai3d::cVector3d(-force[0], -force[1], -force[2]));
        } else {
            const double force = tissue.step(time, -position.z() * MILLIMETRES_PER_METRE);
            // The model's positive force resists the push: on the tip it points out of the tissue.
            device->setForce(chai3d::cVector3d(0.0, 0.0, force));
        }
        device->getUserSwitch(0, button);
    }
}

int main(int count, char *arguments[]) {
    if (count != 2) {
        std::cerr << "usage: chai3d_tissue FOLDER_OF_UNZIPPED_FMU\n";
        return 1;
    }
    chai3d::cHapticDeviceHandler handler;
    chai3d::cGenericHapticDevicePtr device;
    if (!handler.getDevice(device, 0) || !device->open() || !device->calibrate()) {
        std::cerr << "chai3d_tissue: no haptic device\n";
        return 1;
    }
    int status = 0;
    try {
        lumbar::TissueForce tissue(arguments[1], [](const std::string &text) { std::cerr << "FMU: " << text << "\n"; });
        // No more than the device can do.
        const double able = device->getSpecifications().m_maxLinearForce;
        if (able < tissue.get("force_limit")) tissue.set("force_limit", able);
        press(device, tissue);
    } catch (const std::exception &error) {
        std::cerr << error.what() << "\n";
        status = 1;
    }
    device->setForce(chai3d::cVector3d(0.0, 0.0, 0.0)); // a device must never keep the last force
    device->close();
    return status;
}
