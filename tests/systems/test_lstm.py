"""CNN-LSTM and ConvLSTM against plain loops."""

import torch
import torch.nn.functional as functional
from torch import nn

from tactile_viewgcn.systems.conv_lstm import ConvLSTM
from tests.systems.small_systems import built, head_of, some_views


def test_cnn_lstm_classifies_the_last_state_of_the_plain_loop():
    network = built("cnn_lstm")
    head = network.head
    views = some_views(network)
    cell = nn.LSTMCell(16, 16)
    weights = head.memory.state_dict()
    cell.load_state_dict({name.removesuffix("_l0"): weight for name, weight in weights.items()})
    states = [None]
    for view in views.unbind(dim=1):
        states.append(cell(view, states[-1]))
    logits = head(views)[0]
    torch.testing.assert_close(logits, head.classifier(states[-1][0]))
    assert (logits - head.classifier(states[-2][0])).abs().max() > 1e-3


def plain_conv_lstm(system, views):
    """Return the logits by a loop over views and gates.

    Each gate is a convolution of the view plus a convolution of the hidden state.
    """
    batch, _, channels, height, width = views.shape
    weight = system.gates.weight
    bias = system.gates.bias
    hidden, cell = torch.zeros(2, batch, channels, height, width)
    for view in views.unbind(dim=1):
        gates = []
        for gate in range(4):
            rows = slice(gate * channels, (gate + 1) * channels)
            of_view = functional.conv2d(view, weight[rows, :channels], padding=1)
            of_hidden = functional.conv2d(hidden, weight[rows, channels:], padding=1)
            gates.append(of_view + of_hidden + bias[rows, None, None])
        cell = torch.sigmoid(gates[1]) * cell + torch.sigmoid(gates[0]) * torch.tanh(gates[3])
        hidden = torch.sigmoid(gates[2]) * torch.tanh(cell)
    return system.classifier(hidden.flatten(2).sum(dim=2) / (height * width))


def test_conv_lstm_equals_the_plain_loop_over_views_and_gates():
    torch.manual_seed(0)
    system = head_of(ConvLSTM, features=3, classes=4)
    views = torch.randn(2, 5, 3, 4, 6)
    expected = plain_conv_lstm(system, views)
    torch.testing.assert_close(system(views)[0], expected)
    # the cell stays in float32, even if the maps are in bfloat16
    torch.testing.assert_close(system(views.bfloat16())[0], expected, rtol=0, atol=0.01)
