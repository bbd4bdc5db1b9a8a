#pragma once

/* The one place where Simbody's headers come in; for .cpp files of this folder only.

Debian builds Simbody without NDEBUG, and a class of it has another size with NDEBUG: a program
built with it crashes in realizeTopology(). Never `using namespace SimTK`: its Vector, Matrix and
Transform would collide with Eigen's. */
#ifdef NDEBUG
#error "Simbody needs a build without NDEBUG: link to viable::viable, which sets -UNDEBUG"
#endif

// Eigen first, so that nothing of Simbody's can change how Eigen's headers are read.
#include <Eigen/Core>
#include <Eigen/Geometry>

#include <Simbody.h>
