#include "ground/model/dynamics.h"
