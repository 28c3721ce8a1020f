"""Principal components and linear discriminant analysis of single frames."""

from tactile_viewgcn.sensors.pipelines import lda

build = lda
